//! Zenoh's threads. By default a connection that came in is watched by one thread, and read by another that the first
//! wakes: a hand-over more for every message, 0.06 ms of 0.34 on a small virtual machine.

/// Environment variable from which alone Zenoh takes the layout of its threads: whoever starts a process with Zenoh in it
/// sets it for the process.
pub const VARIABLE: &str = "ZENOH_RUNTIME";
/// Layout in which the threads that read connections also accept and open them.
pub const LAYOUT: &str = "(acc: (handover: rx), net: (handover: rx))";
