//! Tests of the app with a simulated operator.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod desk;

mod crash;
mod every_tool;
mod gestures;
mod hands;
mod honest;
mod keyboard_and_touch;
mod measuring;
mod newer;
mod no_display;
mod opening;
mod outside;
mod painted;
mod planes;
mod proposed;
mod saving;
mod together;
mod tour;
mod video;
mod views;
mod windows;
