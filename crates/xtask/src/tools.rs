//! External tools of the checks, and how to install them.

use std::process::Command;

use crate::server;
use crate::workspace::root;

/// External tool of a check, and the commands that install it.
pub(crate) struct Tool {
    pub(crate) name: &'static str,
    pub(crate) is_installed: fn() -> bool,
    pub(crate) install: &'static [&'static [&'static str]],
}

/// Command that updates Debian's package lists.
const UPDATE: &[&str] = &["apt-get", "update", "--quiet"];

/// Builds a command that installs Debian packages.
macro_rules! debian {
    ($($argument:literal),*) => { &["apt-get", "install", "--quiet", "--yes", $($argument),*] };
}

/// Defines a virtual environment with pinned Python packages; it is recreated if the pins change.
macro_rules! python {
    ($name:literal, $folder:literal, $pins:literal) => {
        Tool {
            name: $name,
            is_installed: || has_pinned_packages($folder, $pins),
            install: &[&[
                "sh",
                "-c",
                concat!(
                    "python3 -m venv --clear ",
                    $folder,
                    " || { apt-get update --quiet && apt-get install --quiet --yes python3-venv && python3 -m venv --clear ",
                    $folder,
                    "; }"
                ),
            ], &[
                "sh",
                "-c",
                concat!(
                    $folder,
                    "/bin/python -m pip install --quiet ",
                    $pins,
                    " && printf %s '",
                    $pins,
                    "' > ",
                    $folder,
                    "/ready"
                ),
            ]],
        }
    };
}

pub(crate) const PEERS: Tool = python!(
    "Python packages of the peers",
    "target/peers-venv",
    "numpy==2.4.6 scipy==1.17.1 opencv-python-headless==5.0.0.93 pycolmap==4.2.1 poselib==2.0.5 PyYAML==6.0.3 pyproj==3.7.2"
);

/// Python packages for the tests and the benchmark of archives: `DuckDB`, pandas and `PyArrow`.
pub(crate) const ENGINES: Tool = python!(
    "Python packages of the database engines",
    "target/engines-venv",
    "duckdb==2.0.0 pandas==3.1.1 pyarrow==26.0.1"
);

/// Python packages that build and check the wheel, and packages that users combine with it.
pub(crate) const PYTHON: Tool = python!(
    "Python packages that build and test the wheel",
    "target/python-venv",
    "maturin==1.16.0 numpy==2.4.6 pytest==9.2.0 mypy==2.4.1 twine==6.2.0 auditwheel==6.8.2 matplotlib==3.11.2 \
     nbclient==0.11.0 ipykernel==7.4.0 opencv-python-headless==5.0.0.93 supervision==0.31.2 norfair==2.1.1 \
     pyarrow==26.0.1 polars==2.1.0 pandas==3.1.0 pyspark==4.3.0"
);

/// Ultralytics, with Debian's `PyTorch`. The `PyTorch` from `PyPI` contains gigabytes of GPU libraries.
pub(crate) const ULTRALYTICS: Tool = Tool {
    name: "Ultralytics with Debian's PyTorch",
    is_installed: || {
        runs("target/ultralytics-venv/bin/python", &["-c", "import ultralytics.engine.results, pytest"])
    },
    install: &[
        UPDATE,
        debian!("--no-install-recommends", "python3-torch", "python3-torchvision", "python3-venv"),
        &["/usr/bin/python3", "-m", "venv", "--clear", "--system-site-packages", "target/ultralytics-venv"],
        &[
            "target/ultralytics-venv/bin/python",
            "-m",
            "pip",
            "install",
            "--quiet",
            "numpy==1.26.4",
            "opencv-python-headless==4.11.0.86",
            "matplotlib==3.10.9",
            "pillow",
            "pyyaml",
            "requests",
            "psutil",
            "pytest==9.2.0",
        ],
        // Ultralytics is installed without its dependencies, which would install another `PyTorch`.
        &[
            "target/ultralytics-venv/bin/python",
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-deps",
            "ultralytics==8.4.190",
        ],
    ],
};

pub(crate) const COMPILERS: Tool = Tool {
    name: "C and C++ compilers, and the GStreamer headers",
    is_installed: || is_on_path("cc") && is_on_path("c++") && has_library("gstreamer-video-1.0"),
    install: &[
        UPDATE,
        debian!("--no-install-recommends", "g++", "pkg-config", "libgstreamer-plugins-base1.0-dev"),
    ],
};

pub(crate) const TYPOS: Tool = python!("typos", "target/tools-venv", "typos==1.52.0");

/// Java runtime, required by Spark.
pub(crate) const JAVA: Tool = Tool {
    name: "Java",
    is_installed: || is_on_path("java"),
    install: &[UPDATE, debian!("default-jre-headless")],
};

pub(crate) const FUZZ: Tool = Tool {
    name: "cargo-fuzz and a C++ compiler",
    is_installed: || has_version("target/tools/bin/cargo-fuzz", "cargo-fuzz 0.13.2") && is_on_path("c++"),
    install: &[
        &["sh", "-c", "command -v c++ || { apt-get update --quiet && apt-get install --quiet --yes g++; }"],
        &[
            "cargo",
            "install",
            "--quiet",
            "--locked",
            "--force",
            "--root",
            "target/tools",
            "cargo-fuzz@0.13.2",
        ],
    ],
};

pub(crate) const WEB: Tool = Tool {
    name: "a wasm32 compiler with library sources (rustup or Debian's rustc-web)",
    is_installed: server::has_wasm_compiler,
    install: &[&[
        "sh",
        "-c",
        "timeout 300 rustup component add rust-src || { apt-get update --quiet && \
         apt-get install --quiet --yes rustc-web cargo-web rust-web-src lld; }",
    ]],
};

pub(crate) const SPLIT: Tool = Tool {
    name: "Binaryen's wasm-split",
    is_installed: || is_on_path("wasm-split"),
    install: &[UPDATE, debian!("--no-install-recommends", "binaryen")],
};

/// Lock file of the npm packages in the sources, and its copy next to the installed packages.
const LOCK_FILES: [&str; 2] = ["crates/calib-app/tests/browser/package-lock.json", "target/browser/ready"];

pub(crate) const BROWSER: Tool = Tool {
    name: "Chromium, Node 20 or newer, and the npm packages of the browser tests",
    is_installed: || {
        let [wanted, made] = LOCK_FILES.map(|path| std::fs::read(root().join(path)).ok());
        let mut node = Command::new("node");
        node.args(["--eval", "process.exit(parseInt(process.versions.node) < 20 ? 1 : 0)"]);
        let has_node = node.status().is_ok_and(|status| status.success());
        runs("/usr/bin/chromium", &["--version"]) && has_node && wanted.is_some() && wanted == made
    },
    install: &[
        UPDATE,
        // An existing Node is kept, because it may be newer than Debian's.
        &["sh", "-c", "command -v node && command -v npm || apt-get install --quiet --yes nodejs npm"],
        debian!("chromium"),
        &["mkdir", "-p", "target/browser"],
        &["cp", "crates/calib-app/tests/browser/package.json", LOCK_FILES[0], "target/browser"],
        &["npm", "ci", "--prefix", "target/browser", "--no-fund", "--no-audit"],
        &["cp", LOCK_FILES[0], LOCK_FILES[1]],
    ],
};

/// Whether a tool is available, after installing it if `install` is set and it is missing.
pub(crate) fn is_ready(tool: &Tool, install: bool) -> bool {
    if (tool.is_installed)() {
        return true;
    }
    if install {
        println!("\n== installing {}", tool.name);
        for command in tool.install {
            let Some((program, arguments)) = command.split_first() else { continue };
            let done = Command::new(program).args(arguments).current_dir(root()).status();
            if !done.is_ok_and(|status| status.success()) {
                println!("== {} failed", command.join(" "));
                return false;
            }
        }
    }
    let is_installed = (tool.is_installed)();
    if install && !is_installed {
        println!("== {} was installed, but is still missing or has the wrong version", tool.name);
    }
    is_installed
}

/// Whether a program runs successfully. A relative path starts at the root of the workspace.
pub(crate) fn runs(program: &str, arguments: &[&str]) -> bool {
    let output = Command::new(root().join(program)).args(arguments).output();
    output.is_ok_and(|output| output.status.success())
}

/// Whether a program in the workspace reports this version.
fn has_version(program: &str, version: &str) -> bool {
    let output = Command::new(root().join(program)).arg("--version").output();
    output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).trim() == version)
}

/// Whether a virtual environment was created with these pinned packages.
fn has_pinned_packages(folder: &str, pins: &str) -> bool {
    std::fs::read_to_string(root().join(folder).join("ready")).is_ok_and(|made| made == pins)
}

/// Whether pkg-config finds the library's headers.
fn has_library(library: &str) -> bool {
    Command::new("pkg-config").args(["--exists", library]).status().is_ok_and(|status| status.success())
}

/// Whether a program on the search path succeeds with `--version`.
fn is_on_path(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}
