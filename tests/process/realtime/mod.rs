//! Tests that measure time. `.config/nextest.toml` runs every module of this name alone, and tries its tests again where
//! the host itself stood still.

mod autopilot;
mod floods;
mod hardware_in_the_loop;
mod links;
mod live;
mod restarts;
mod virtual_machine;
