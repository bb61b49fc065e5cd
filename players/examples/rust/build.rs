// SPDX-License-Identifier: MIT
//! Names the folder of the compiled core to the linker: HFX_LIBRARY_DIR in the environment.

fn main() {
    println!("cargo:rerun-if-env-changed=HFX_LIBRARY_DIR");
    if let Ok(folder) = std::env::var("HFX_LIBRARY_DIR") {
        println!("cargo:rustc-link-search=native={folder}");
    }
}
