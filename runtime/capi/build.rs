//! Names the shared library as it is installed: `make capi` gives the file that name.

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    // The number is PLUMBLINE_ABI of the header (`src/version.rs`).
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libplumbline.so.0");
}
