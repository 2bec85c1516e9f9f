//! The one test binary.

mod scene;
