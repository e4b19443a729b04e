//! Keeps a release small, where rustc brings its own linker, which knows the options, and nobody has chosen another.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let is = |name: &str, value: &str| std::env::var(name).is_ok_and(|found| found == value);
    let own = is("TARGET", "x86_64-unknown-linux-gnu")
        && is("PROFILE", "release")
        && std::env::var_os("RUSTC_LINKER").is_none()
        && !std::env::var("CARGO_ENCODED_RUSTFLAGS").is_ok_and(|flags| flags.contains("link"));
    if !own {
        return;
    }
    // Generic code comes out alike by the hundred.
    println!("cargo::rustc-link-arg-bins=-Wl,--icf=all");
    // Texts that end alike are kept once.
    println!("cargo::rustc-link-arg-bins=-Wl,-O2");
    // Relative relocations in a bit map in place of 24 bytes each: glibc reads it since 2.36 (Debian 12).
    if glibc().is_some_and(|version| version >= (2, 36)) {
        println!("cargo::rustc-link-arg-bins=-Wl,-z,pack-relative-relocs");
    }
}

/// The version of this machine's C library.
fn glibc() -> Option<(u32, u32)> {
    let told = Command::new("getconf").arg("GNU_LIBC_VERSION").output().ok()?;
    let told = String::from_utf8(told.stdout).ok()?;
    let (major, minor) = told.trim().strip_prefix("glibc ")?.split_once('.')?;
    Some((major.parse().ok()?, minor.parse().ok()?))
}
