//! What tests of every kind share: starting the program, and finding data beside the checkout.

pub mod data;
pub mod program;
