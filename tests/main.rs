//! The one test binary.

mod twins;
