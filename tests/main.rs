//! The one test binary.
mod builtin;
