//! This module says which program this is. `build.rs` beside it is the build script that finds the
//! commit.

/// This is the program's version.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// This is the version, with the commit behind it where that is known.
pub const WITH_COMMIT: &str = env!("GSPOTENTIAL_VERSION");

/// This is the commit that it was built from; `None` outside of a repository and of a package.
pub const COMMIT: Option<&str> = option_env!("GSPOTENTIAL_COMMIT");
