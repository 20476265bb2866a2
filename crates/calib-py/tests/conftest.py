"""Fixtures with the demonstration site and the golden points, which `cargo xtask golden` writes."""

import os
from pathlib import Path

import pytest

import calib

FOLDER = Path(os.environ.get("CALIB_GOLDEN", Path(__file__).parents[3] / "target/golden"))


@pytest.fixture(scope="session")
def folder() -> Path:
    assert FOLDER.exists(), f"{FOLDER} is missing; run `cargo xtask golden`"
    return FOLDER


@pytest.fixture(scope="session")
def site(folder: Path) -> calib.Site:
    return calib.Site.open(folder / "site.json")


@pytest.fixture(scope="session")
def camera(site: calib.Site) -> calib.Camera:
    return site.camera(site.cameras[1])
