//! Tests that measure time. `make realtime` runs every module of this name, one test at a time.

mod attacks;
pub mod autopilot;
mod disks;
mod floods;
pub mod hardware_in_the_loop;
mod hostile;
mod instants;
mod links;
pub mod live;
mod long_flight;
mod restarts;
mod silent;
mod virtual_machine;
