//! Data that tests find beside the checkout.
//!
//! A test that needs more than the repository is ignored unless asked for, and says what it needs:
//! `#[ignore = "needs ../shared/scenes"]`. `.ci/test` runs those whose need is met and counts the
//! others. A test that runs without its data fails here.

use std::path::{Path, PathBuf};

/// `../shared/{name}` beside the checkout.
#[track_caller]
pub(crate) fn shared(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../shared")
        .join(name);
    assert!(path.exists(), "this test needs {}", path.display());
    path
}
