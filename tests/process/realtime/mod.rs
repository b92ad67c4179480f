//! Tests that measure time. `make realtime` runs every module of this name, one test at a time.

mod attacks;
mod autopilot;
mod floods;
mod hardware_in_the_loop;
mod links;
mod live;
mod long_flight;
#[cfg(feature = "sabotage")]
mod restart_in_the_air;
mod restarts;
#[cfg(feature = "sabotage")]
mod stalls;
#[cfg(feature = "sabotage")]
mod survival;
#[cfg(feature = "sabotage")]
mod systemd;
mod virtual_machine;
