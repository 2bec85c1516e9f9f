//! What tests of every kind share: starting the program, and finding data beside the checkout.

pub(crate) mod data;
pub(crate) mod program;
