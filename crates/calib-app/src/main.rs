//! The native window, and the canvas of the browser.

#[cfg(not(target_arch = "wasm32"))]
fn main() -> eframe::Result {
    let viewport = egui::ViewportBuilder::default()
        .with_title("calib")
        .with_inner_size([1440.0, 900.0])
        .with_min_inner_size([800.0, 500.0])
        .with_drag_and_drop(true);
    let options = eframe::NativeOptions { viewport, ..Default::default() };
    let paths: Vec<std::path::PathBuf> = std::env::args_os().skip(1).map(Into::into).collect();
    eframe::run_native(
        "calib",
        options,
        Box::new(|creation| {
            let folder = calib_app::files::data_dir();
            let mut app = calib_app::App::new(&creation.egui_ctx, folder);
            for path in paths {
                app.take_path(&creation.egui_ctx, path);
            }
            Ok(Box::new(app))
        }),
    )
}

#[cfg(target_arch = "wasm32")]
fn main() {
    calib_app::browser::start();
}
