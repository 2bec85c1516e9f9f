//! What tests of every kind share: starting the program, keeping a
//! training's state, and finding data beside the checkout.

pub(crate) mod data;
pub(crate) mod keep;
pub(crate) mod program;
