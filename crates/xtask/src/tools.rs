//! What the checks need beside Rust: tools, and how they are installed.

use std::process::Command;

use crate::serve;
use crate::workspace::root;

/// What a check needs beside Rust, and how to get it.
pub(crate) struct Tool {
    pub(crate) name: &'static str,
    pub(crate) is_there: fn() -> bool,
    pub(crate) install: &'static [&'static [&'static str]],
}

/// Debian's lists of packages as they are today.
const UPDATE: &[&str] = &["apt-get", "update", "--quiet"];

/// Installs packages of Debian.
macro_rules! debian {
    ($($argument:literal),*) => { &["apt-get", "install", "--quiet", "--yes", $($argument),*] };
}

/// A folder of Python packages at these versions; where they are raised, it is made anew.
macro_rules! python {
    ($name:literal, $folder:literal, $pins:literal) => {
        Tool {
            name: $name,
            is_there: || is_made($folder, $pins),
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
    "the peers' Python packages",
    "target/peers-venv",
    "numpy==2.4.6 scipy==1.17.1 opencv-python-headless==5.0.0.93 pycolmap==4.2.1 PyYAML==6.0.3"
);

/// `DuckDB`, for the tests and the benchmark of archives.
pub(crate) const ENGINES: Tool = python!(
    "the engines' Python packages",
    "target/engines-venv",
    "duckdb==2.0.0 pandas==3.1.1 pyarrow==26.0.1"
);

/// What builds the wheel, what checks it, and the packages that its users have.
pub(crate) const PYTHON: Tool = python!(
    "what builds and tries the wheel",
    "target/python-venv",
    "maturin==1.16.0 numpy==2.4.6 pytest==9.2.0 mypy==2.4.1 twine==6.2.0 auditwheel==6.8.2 matplotlib==3.11.2 \
     nbclient==0.11.0 ipykernel==7.4.0 opencv-python-headless==5.0.0.93 supervision==0.31.2 norfair==2.1.1 \
     pyarrow==26.0.1 polars==2.1.0 pandas==3.1.0 pyspark==4.3.0"
);

/// Ultralytics, with Debian's `PyTorch`: that of `PyPI` is of gigabytes for graphics processors.
pub(crate) const ULTRALYTICS: Tool = Tool {
    name: "Ultralytics with Debian's PyTorch",
    is_there: || {
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
        // Without what it asks for: another `PyTorch`.
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
    name: "compilers for C and C++, and GStreamer's headers",
    is_there: || is_on_path("cc") && is_on_path("c++") && finds("gstreamer-video-1.0"),
    install: &[
        UPDATE,
        debian!("--no-install-recommends", "g++", "pkg-config", "libgstreamer-plugins-base1.0-dev"),
    ],
};

pub(crate) const TYPOS: Tool = python!("typos", "target/tools-venv", "typos==1.52.0");

/// For Spark.
pub(crate) const JAVA: Tool = Tool {
    name: "Java",
    is_there: || is_on_path("java"),
    install: &[UPDATE, debian!("default-jre-headless")],
};

pub(crate) const FUZZ: Tool = Tool {
    name: "cargo-fuzz, and the C++ compiler that its engine wants",
    is_there: || says("target/tools/bin/cargo-fuzz", "cargo-fuzz 0.13.2") && is_on_path("c++"),
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
    name: "a Rust that builds for wasm32, its library included (rustup's, or Debian's rustc-web)",
    is_there: serve::is_there,
    install: &[&[
        "sh",
        "-c",
        "timeout 300 rustup component add rust-src || { apt-get update --quiet && \
         apt-get install --quiet --yes rustc-web cargo-web rust-web-src lld; }",
    ]],
};

pub(crate) const SPLIT: Tool = Tool {
    name: "Binaryen's wasm-split",
    is_there: || is_on_path("wasm-split"),
    install: &[UPDATE, debian!("--no-install-recommends", "binaryen")],
};

/// What is wanted of npm, beside what was installed for it.
const LOCK: [&str; 2] = ["crates/calib-app/tests/browser/package-lock.json", "target/browser/ready"];

pub(crate) const BROWSER: Tool = Tool {
    name: "Chromium, Node 20 or newer, and what drives a browser",
    is_there: || {
        let [wanted, made] = LOCK.map(|path| std::fs::read(root().join(path)).ok());
        let mut node = Command::new("node");
        node.args(["--eval", "process.exit(parseInt(process.versions.node) < 20 ? 1 : 0)"]);
        let has_node = node.status().is_ok_and(|status| status.success());
        runs("/usr/bin/chromium", &["--version"]) && has_node && wanted.is_some() && wanted == made
    },
    install: &[
        UPDATE,
        // Whoever has a newer Node from elsewhere keeps it.
        &["sh", "-c", "command -v node && command -v npm || apt-get install --quiet --yes nodejs npm"],
        debian!("chromium"),
        &["mkdir", "-p", "target/browser"],
        &["cp", "crates/calib-app/tests/browser/package.json", LOCK[0], "target/browser"],
        &["npm", "ci", "--prefix", "target/browser", "--no-fund", "--no-audit"],
        &["cp", LOCK[0], LOCK[1]],
    ],
};

/// Whether a tool is there, after installing it if that is wanted.
pub(crate) fn ready(tool: &Tool, install: bool) -> bool {
    if (tool.is_there)() {
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
    let is_there = (tool.is_there)();
    if install && !is_there {
        println!("== {} was installed and is still not what the checks want", tool.name);
    }
    is_there
}

/// Whether a program of the workspace's tools runs.
pub(crate) fn runs(program: &str, arguments: &[&str]) -> bool {
    let output = Command::new(root().join(program)).args(arguments).output();
    output.is_ok_and(|output| output.status.success())
}

/// Whether a program of the workspace's tools is this version.
fn says(program: &str, version: &str) -> bool {
    let output = Command::new(root().join(program)).arg("--version").output();
    output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).trim() == version)
}

/// Whether a folder of packages was made with these.
fn is_made(folder: &str, pins: &str) -> bool {
    std::fs::read_to_string(root().join(folder).join("ready")).is_ok_and(|made| made == pins)
}

/// Whether a library's headers are there.
fn finds(library: &str) -> bool {
    Command::new("pkg-config").args(["--exists", library]).status().is_ok_and(|status| status.success())
}

/// Whether there is a program of this name, wherever it is installed.
fn is_on_path(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success())
}
