//! This module describes the columns of a table, and the cells under them.

use std::borrow::Cow;

use crate::report::stats::Figure;

/// What the cells of a column are.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    /// Words, aligned to the left.
    Text,
    /// Words about a quantity, aligned to the right: `12 of 30`, `0.3 ms`.
    Quantity,
    /// Single numbers, shown with so many digits after the point.
    Number { digits: usize },
    /// Means over runs, each with its standard deviation where that is known.
    Figure { digits: usize },
}

/// Which figures of a column are the better ones.
#[derive(Clone, Copy, Debug)]
pub(super) enum Better {
    Higher,
    Lower,
}

/// A column: its key in files, its heading on paper, what stands in it.
#[derive(Clone, Debug)]
pub struct Column {
    pub(super) key: &'static str,
    heading: Cow<'static, str>,
    pub(super) kind: Kind,
    pub(super) better: Option<Better>,
}

impl Column {
    const fn new(key: &'static str, heading: &'static str, kind: Kind) -> Column {
        Column {
            key,
            heading: Cow::Borrowed(heading),
            kind,
            better: None,
        }
    }

    /// Returns a column of words, aligned to the left.
    pub const fn text(key: &'static str, heading: &'static str) -> Column {
        Column::new(key, heading, Kind::Text)
    }

    /// Returns a column of words about a quantity (`12 of 30`, `0.3 ms`), aligned to the right.
    pub const fn quantity(key: &'static str, heading: &'static str) -> Column {
        Column::new(key, heading, Kind::Quantity)
    }

    /// Returns a column of single numbers, shown with `digits` digits after the point.
    pub const fn number(key: &'static str, heading: &'static str, digits: usize) -> Column {
        Column::new(key, heading, Kind::Number { digits })
    }

    /// Returns a column of means over runs; CSV has their standard deviations in `KEY_deviation`.
    pub const fn figure(key: &'static str, heading: &'static str, digits: usize) -> Column {
        Column::new(key, heading, Kind::Figure { digits })
    }

    /// Returns the same column under a heading that is known at run time only.
    pub fn headed(self, heading: impl Into<Cow<'static, str>>) -> Column {
        Column {
            heading: heading.into(),
            ..self
        }
    }

    /// Returns the same column, marked as one in which more is better.
    pub const fn higher_is_better(mut self) -> Column {
        self.better = Some(Better::Higher);
        self
    }

    /// Returns the same column, marked as one in which less is better.
    pub const fn lower_is_better(mut self) -> Column {
        self.better = Some(Better::Lower);
        self
    }

    pub(super) fn is_left(&self) -> bool {
        matches!(self.kind, Kind::Text)
    }

    pub(super) fn shown_heading(&self) -> String {
        let arrow = match self.better {
            Some(Better::Higher) => " ↑",
            Some(Better::Lower) => " ↓",
            None => "",
        };
        format!("{}{arrow}", self.heading)
    }

    pub(super) fn shown_number(&self, value: f64) -> String {
        let digits = match self.kind {
            Kind::Text | Kind::Quantity => 0,
            Kind::Number { digits } | Kind::Figure { digits } => digits,
        };
        format!("{value:.digits$}")
    }

    fn shown_figure(&self, Figure { mean, deviation }: &Figure) -> String {
        match deviation {
            Some(deviation) => format!(
                "{} ± {}",
                self.shown_number(*mean),
                self.shown_number(*deviation)
            ),
            None => self.shown_number(*mean),
        }
    }

    /// Returns the cell as people read it, the best in Markdown's bold.
    pub(super) fn shown(&self, cell: &Cell) -> String {
        match cell {
            Cell::Empty => String::new(),
            Cell::Text(text) => text.clone(),
            Cell::Figure(None) => NOT_MEASURED.to_owned(),
            Cell::Figure(Some(figure)) => self.shown_figure(figure),
            Cell::Best(figure) => format!("**{}**", self.shown_figure(figure)),
        }
    }
}

/// Stands for a figure that was not measured.
pub(super) const NOT_MEASURED: &str = "n/a";

/// A cell of a row, under a column of its kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Nothing belongs here.
    Empty,
    /// Words, shown as they are.
    Text(String),
    /// A number with its spread; `None` if it was not measured.
    Figure(Option<Figure>),
    /// A figure that none of its rows exceeds.
    Best(Figure),
}

impl Cell {
    pub(super) fn figure(&self) -> Option<&Figure> {
        match self {
            Cell::Figure(figure) => figure.as_ref(),
            Cell::Best(figure) => Some(figure),
            Cell::Empty | Cell::Text(_) => None,
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
    }
}

impl From<&String> for Cell {
    fn from(text: &String) -> Cell {
        Cell::Text(text.clone())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<Option<Figure>> for Cell {
    fn from(figure: Option<Figure>) -> Cell {
        Cell::Figure(figure)
    }
}

impl From<Option<f64>> for Cell {
    fn from(value: Option<f64>) -> Cell {
        Cell::Figure(value.map(Figure::exact))
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Cell {
        Some(value).into()
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Cell {
        (count as f64).into()
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Cell {
        (count as f64).into()
    }
}
