//! A key is declared as `key: type = default, rule;` under a comment that says what it means.
//!
//! The struct with its reading and writing, the defaults, the checks ([`super::validate`]) and the
//! reference ([`super::reference`]) all come from that one line.

use std::fmt::{self, Display};

/// The rule of a key: its allowed values, and what a reader should know beside its meaning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// The numbers that pass validation.
    pub allowed: Allowed,
    /// Unit where the key's name has none; empty for a plain number.
    pub unit: &'static str,
    /// The paper's symbol or equation, empty for what the paper does not have.
    pub paper: &'static str,
}

/// The numbers that a key may be. NaN is none of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// Whatever the type holds.
    Any,
    /// Any number of the interval.
    Interval(Interval),
    /// 0, or a number of the interval.
    ZeroOr(Interval),
    /// An odd number from 1 up to this.
    Odd(f64),
}

/// Finite numbers from `low` to `high`; an open end is not one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The lower end.
    pub low: f64,
    /// Whether `low` itself is left out.
    pub low_open: bool,
    /// The upper end; infinite if there is none.
    pub high: f64,
    /// Whether `high` itself is left out.
    pub high_open: bool,
}

impl Rule {
    /// Returns the same rule with a unit for the reference.
    pub const fn unit(self, unit: &'static str) -> Rule {
        Rule { unit, ..self }
    }

    /// Returns the same rule with the paper's symbol or equation for the reference.
    pub const fn paper(self, paper: &'static str) -> Rule {
        Rule { paper, ..self }
    }
}

const fn rule(allowed: Allowed) -> Rule {
    Rule {
        allowed,
        unit: "",
        paper: "",
    }
}

const fn interval(low: f64, low_open: bool, high: f64, high_open: bool) -> Rule {
    rule(Allowed::Interval(Interval {
        low,
        low_open,
        high,
        high_open,
    }))
}

/// Allows whatever the type holds.
pub(crate) const fn any() -> Rule {
    rule(Allowed::Any)
}

/// Allows numbers from `low` to `high`, both included.
pub(crate) const fn within(low: f64, high: f64) -> Rule {
    interval(low, false, high, false)
}

/// Allows numbers from `low` to `high`, `low` excluded.
pub(crate) const fn above_to(low: f64, high: f64) -> Rule {
    interval(low, true, high, false)
}

/// Allows numbers from `low` to `high`, `high` excluded.
pub(crate) const fn from_below(low: f64, high: f64) -> Rule {
    interval(low, false, high, true)
}

/// Allows numbers from `low` to `high`, both excluded.
pub(crate) const fn between(low: f64, high: f64) -> Rule {
    interval(low, true, high, true)
}

/// Allows any finite number above 0.
pub(crate) const fn positive() -> Rule {
    between(0.0, f64::INFINITY)
}

/// Allows any finite number from `low`.
pub(crate) const fn at_least(low: f64) -> Rule {
    from_below(low, f64::INFINITY)
}

/// Allows 0, or numbers from `low` to `high`.
pub(crate) const fn zero_or(low: f64, high: f64) -> Rule {
    rule(Allowed::ZeroOr(Interval {
        low,
        low_open: false,
        high,
        high_open: false,
    }))
}

/// Allows the side of a window that has a middle pixel.
pub(crate) const fn odd_window() -> Rule {
    rule(Allowed::Odd(63.0))
}

impl Interval {
    fn holds(&self, x: f64) -> bool {
        let above = if self.low_open {
            x > self.low
        } else {
            x >= self.low
        };
        let below = if self.high_open {
            x < self.high
        } else {
            x <= self.high
        };
        above && below
    }
}

impl Allowed {
    /// Returns whether `x` is allowed.
    pub fn holds(&self, x: f64) -> bool {
        match self {
            Allowed::Any => true,
            Allowed::Interval(interval) => interval.holds(x),
            Allowed::ZeroOr(interval) => x == 0.0 || interval.holds(x),
            Allowed::Odd(most) => (1.0..=*most).contains(&x) && x % 2.0 == 1.0,
        }
    }
}

impl Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (low, high) = (self.low, self.high);
        match (self.low_open, self.high_open, high == f64::INFINITY) {
            (true, _, true) => write!(f, "a finite number above {low}"),
            (false, _, true) => write!(f, "a finite number, {low} or more"),
            (false, false, _) => write!(f, "{low} to {high}"),
            (false, true, _) => write!(f, "at least {low} and below {high}"),
            (true, false, _) => write!(f, "above {low}, at most {high}"),
            (true, true, _) => write!(f, "above {low} and below {high}"),
        }
    }
}

impl Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Allowed::Any => Ok(()),
            Allowed::Interval(interval) => interval.fmt(f),
            Allowed::ZeroOr(interval) => write!(f, "0, or {interval}"),
            Allowed::Odd(most) => write!(f, "an odd number from 1 to {most}"),
        }
    }
}

/// A key, or a section of keys, with the value that a config has.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    /// The dotted name as `--set` takes it.
    pub key: String,
    pub doc: String,
    pub rule: Rule,
    /// The value's numbers: none, one, or one for each channel of a colour.
    pub numbers: Vec<f64>,
    pub nullable: bool,
    /// The words that it may be; empty for what is no word.
    pub choices: &'static [&'static str],
    /// Whether it holds keys instead of a value.
    pub is_section: bool,
}

/// A type that a key can hold.
pub(crate) trait Value {
    const NULLABLE: bool = false;
    const CHOICES: &'static [&'static str] = &[];

    fn numbers(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Lists this value, and what lies below it, under its dotted name.
    fn list(&self, key: &str, doc: &str, rule: Rule, entries: &mut Vec<Entry>) {
        entries.push(Entry {
            key: key.to_owned(),
            doc: doc.trim().to_owned(),
            rule,
            numbers: self.numbers(),
            nullable: Self::NULLABLE,
            choices: Self::CHOICES,
            is_section: false,
        });
    }
}

macro_rules! numbers {
    ($($type:ty),*) => {
        $(impl Value for $type {
            fn numbers(&self) -> Vec<f64> {
                vec![*self as f64]
            }
        })*
    };
}
numbers!(f64, u32, usize);

impl Value for String {}
impl Value for bool {}
/// A seed; nothing is checked of it, and not every one of them is an `f64`.
impl Value for u64 {}

impl<T: Value> Value for Option<T> {
    const NULLABLE: bool = true;
    const CHOICES: &'static [&'static str] = T::CHOICES;

    fn numbers(&self) -> Vec<f64> {
        self.as_ref().map_or_else(Vec::new, Value::numbers)
    }
}

impl<const N: usize> Value for [f64; N] {
    fn numbers(&self) -> Vec<f64> {
        self.to_vec()
    }
}

/// Declares a section: a struct, its defaults and the list of its keys.
macro_rules! section {
    (
        $(#[doc = $about:literal])*
        struct $name:ident {
            $($(#[doc = $doc:literal])* $key:ident: $type:ty = $default:expr, $rule:expr;)*
        }
    ) => {
        $(#[doc = $about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[doc = $doc])* pub $key: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $default,)* }
            }
        }

        impl $crate::config::declare::Value for $name {
            fn list(
                &self,
                key: &str,
                doc: &str,
                rule: $crate::config::declare::Rule,
                entries: &mut Vec<$crate::config::declare::Entry>,
            ) {
                if !key.is_empty() {
                    entries.push($crate::config::declare::Entry {
                        key: key.to_owned(),
                        doc: doc.trim().to_owned(),
                        rule,
                        numbers: Vec::new(),
                        nullable: false,
                        choices: &[],
                        is_section: true,
                    });
                }
                let prefix = if key.is_empty() { String::new() } else { format!("{key}.") };
                $($crate::config::declare::Value::list(
                    &self.$key,
                    &format!("{prefix}{}", stringify!($key)),
                    concat!($($doc),*),
                    $rule,
                    entries,
                );)*
            }
        }
    };
}

/// Declares a key's words: an enum whose variants are written as such in JSON.
macro_rules! choice {
    (
        $(#[doc = $about:literal])*
        enum $name:ident {
            $($(#[doc = $doc:literal])* $variant:ident = $word:literal,)*
        }
    ) => {
        $(#[doc = $about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $name {
            $($(#[doc = $doc])* #[serde(rename = $word)] $variant,)*
        }

        impl $crate::config::declare::Value for $name {
            const CHOICES: &'static [&'static str] = &[$($word),*];
        }
    };
}

pub(super) use {choice, section};
