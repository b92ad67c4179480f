//! The `plumbline` command.

use plumbline::alloc::CountingAllocator;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    plumbline::net::threads::lay_out();
    plumbline::cli::main()
}
