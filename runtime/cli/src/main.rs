//! The `plumbline` command.

use plumbline_flight::alloc::CountingAllocator;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    plumbline::main()
}
