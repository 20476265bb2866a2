//! Entry point: the native window, or the canvas of the browser.

#[cfg(not(target_arch = "wasm32"))]
fn main() -> std::process::ExitCode {
    use std::process::ExitCode;

    let paths: Vec<std::path::PathBuf> = std::env::args_os().skip(1).map(Into::into).collect();
    let said = paths.iter().find_map(|path| match path.to_str() {
        Some("--help" | "-h") => Some((HELP.to_owned(), ExitCode::SUCCESS)),
        Some("--version" | "-V") => {
            Some((format!("calib-app {}", env!("CARGO_PKG_VERSION")), ExitCode::SUCCESS))
        }
        Some(other) if other.starts_with('-') => {
            Some((format!("Unknown option {other}.\n\n{HELP}"), ExitCode::from(2)))
        }
        _ => None,
    });
    if let Some((words, code)) = said {
        println!("{words}");
        return code;
    }
    match window(paths) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let has_display =
                ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
            let (why, advice) = if has_display || cfg!(any(windows, target_os = "macos")) {
                (error.to_string(), "")
            } else {
                let advice = "Start the app in a desktop session, or set DISPLAY or WAYLAND_DISPLAY. ";
                ("no display was found".to_owned(), advice)
            };
            eprintln!(
                "The window could not be opened: {why}.\n{advice}To calibrate without a window, run `calib solve` \
                 on a site file."
            );
            ExitCode::FAILURE
        }
    }
}

#[cfg(not(target_arch = "wasm32"))]
const HELP: &str = "Opens a window to calibrate cameras from their images.

Usage: calib-app [FILE]...

FILE is a site (.json), an image (such as .png or .jpg), a folder of images, a video,
or a floor plan (such as .pdf, .dxf or .svg).

Options:
  -h, --help     print this help
  -V, --version  print the version";

/// Opens the window, and the files named on the command line.
#[cfg(not(target_arch = "wasm32"))]
fn window(paths: Vec<std::path::PathBuf>) -> eframe::Result {
    let viewport = egui::ViewportBuilder::default()
        .with_title("calib")
        .with_inner_size([1440.0, 900.0])
        .with_min_inner_size([800.0, 500.0])
        .with_drag_and_drop(true);
    let options = eframe::NativeOptions { viewport, ..Default::default() };
    eframe::run_native(
        "calib",
        options,
        Box::new(|creation| {
            let folder = calib_app::storage::files::data_dir();
            let mut app = calib_app::App::new(&creation.egui_ctx, folder);
            // Relative paths refer to the working directory, not to the site's folder.
            let absolute = |path: std::path::PathBuf| std::path::absolute(&path).unwrap_or(path);
            app.open_paths(&creation.egui_ctx, paths.into_iter().map(absolute));
            Ok(Box::new(app))
        }),
    )
}

#[cfg(target_arch = "wasm32")]
fn main() {
    calib_app::browser::start();
}
