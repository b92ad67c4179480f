//! Faults on purpose: tasks that die or spin, power that fails, a supervisor that starts the command again. The command under
//! test has the feature `sabotage` and a target folder of its own: `make faults`.

mod restart_in_the_air;
mod stalls;
mod supervisor;
mod survival;
mod systemd;
