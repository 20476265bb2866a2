//! The native window, and the canvas of the browser.

#[cfg(not(target_arch = "wasm32"))]
fn main() -> eframe::Result {
    let viewport = egui::ViewportBuilder::default()
        .with_title("calib")
        .with_inner_size([1440.0, 900.0])
        .with_min_inner_size([800.0, 500.0])
        .with_drag_and_drop(true);
    let options = eframe::NativeOptions { viewport, ..Default::default() };
    let path = std::env::args_os().nth(1).map(std::path::PathBuf::from);
    eframe::run_native(
        "calib",
        options,
        Box::new(|creation| {
            let folder = calib_app::files::data_dir();
            let mut app = calib_app::App::new(&creation.egui_ctx, folder);
            if let Some(path) = path {
                app.open_path(&path);
            }
            Ok(Box::new(app))
        }),
    )
}

#[cfg(target_arch = "wasm32")]
fn main() {}
