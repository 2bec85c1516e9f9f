//! Studies: their statistics, their tables, and small ones from end to end.

mod end_to_end;
mod every;
mod figures;
mod kit;
mod renders;
