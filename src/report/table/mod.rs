//! This module holds the one type of all tables: rows of cells under typed columns, written as
//! Markdown for people, and as CSV and JSON for programs.

mod column;

pub use column::{Cell, Column};

use std::fmt::{self, Write as _};
use std::ops::Range;

use serde::Serialize;
use serde_json::{Map, Value, json};

use column::{Better, Kind, NOT_MEASURED};

use crate::error::{Error, Result};

/// Rows of cells under columns. It is shown as Markdown.
#[derive(Clone, Debug)]
pub struct Table {
    /// Name of its files.
    pub name: String,
    columns: Vec<Column>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Returns a table without rows.
    pub fn new(name: &str, columns: &[Column]) -> Table {
        Table {
            name: name.to_owned(),
            columns: columns.to_vec(),
            rows: Vec::new(),
        }
    }

    /// Appends a row; cells beyond the columns are left out, missing ones are empty.
    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        let mut row: Vec<Cell> = cells.into_iter().collect();
        row.resize(self.columns.len(), Cell::Empty);
        self.rows.push(row);
    }

    /// Returns how many rows there are.
    pub fn n_rows(&self) -> usize {
        self.rows.len()
    }

    /// Marks the best figures among `rows`, which compare, in each column that says what is better.
    /// What equals the best as shown is best, too; a figure alone is not.
    pub fn mark_best(&mut self, rows: Range<usize>) {
        let rows = &mut self.rows[rows];
        for (k, column) in self.columns.iter().enumerate() {
            let means = rows.iter().filter_map(|row| row[k].figure());
            let means: Vec<f64> = means.map(|figure| figure.mean).collect();
            let best = match column.better {
                Some(Better::Higher) => means.iter().copied().max_by(f64::total_cmp),
                Some(Better::Lower) => means.iter().copied().min_by(f64::total_cmp),
                None => None,
            };
            let Some(best) = best.filter(|_| means.len() > 1) else {
                continue;
            };
            let best = column.shown_number(best);
            for cell in rows.iter_mut().map(|row| &mut row[k]) {
                match cell.figure() {
                    Some(figure) if column.shown_number(figure.mean) == best => {
                        *cell = Cell::Best(*figure);
                    }
                    _ => {}
                }
            }
        }
    }

    /// Returns the headings, then the rows, as people read them: not escaped, figures with their
    /// digits.
    pub fn shown(&self) -> Vec<Vec<String>> {
        let header = self.columns.iter().map(Column::shown_heading).collect();
        let row = |cells: &Vec<Cell>| {
            let cells = cells.iter().zip(&self.columns);
            cells.map(|(cell, column)| column.shown(cell)).collect()
        };
        std::iter::once(header)
            .chain(self.rows.iter().map(row))
            .collect()
    }

    /// Returns the table for programs: numbers in full, each figure followed by its standard
    /// deviation in a column `KEY_deviation`.
    ///
    /// # Errors
    /// None that a table's content can cause.
    pub fn to_csv(&self) -> Result<String> {
        let header = self.columns.iter().flat_map(|column| match column.kind {
            Kind::Figure { .. } => vec![column.key.to_owned(), format!("{}_deviation", column.key)],
            _ => vec![column.key.to_owned()],
        });
        let number = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
        let record = |(cell, column): (&Cell, &Column)| {
            let text = match cell {
                Cell::Text(text) => text.clone(),
                _ => number(cell.figure().map(|f| f.mean)),
            };
            match column.kind {
                Kind::Figure { .. } => {
                    vec![text, number(cell.figure().and_then(|f| f.deviation))]
                }
                _ => vec![text],
            }
        };
        csv_text(&self.name, |out| {
            out.write_record(header)?;
            for row in &self.rows {
                out.write_record(row.iter().zip(&self.columns).flat_map(record))?;
            }
            Ok(())
        })
    }

    /// Returns the table as JSON, an object for each row.
    pub fn to_json(&self) -> Value {
        let object = |row: &Vec<Cell>| -> Value {
            let cells = row.iter().zip(&self.columns);
            let values = cells.map(|(cell, column)| {
                let value = match (cell, column.kind) {
                    (Cell::Text(text), _) => json!(text),
                    (_, Kind::Figure { .. }) => json!(cell.figure()),
                    _ => json!(cell.figure().map(|figure| figure.mean)),
                };
                (column.key.to_owned(), value)
            });
            Value::Object(values.collect::<Map<_, _>>())
        };
        json!({
            "name": self.name,
            "rows": self.rows.iter().map(object).collect::<Vec<_>>(),
        })
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut rows = self.shown();
        for cell in rows.iter_mut().flatten() {
            *cell = escaped(cell);
        }
        let width = |k: usize| {
            let widths = rows.iter().map(|row| row[k].chars().count());
            widths.max().unwrap_or(0).max(3)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        for (i, row) in rows.iter().enumerate() {
            f.write_char('|')?;
            for ((cell, &width), column) in row.iter().zip(&widths).zip(&self.columns) {
                match column.is_left() {
                    true => write!(f, " {cell:width$} |")?,
                    false => write!(f, " {cell:>width$} |")?,
                }
            }
            f.write_char('\n')?;
            if i == 0 {
                f.write_char('|')?;
                for (&width, column) in widths.iter().zip(&self.columns) {
                    match column.is_left() {
                        true => write!(f, "{}|", "-".repeat(width + 2))?,
                        false => write!(f, "{}:|", "-".repeat(width + 1))?,
                    }
                }
                f.write_char('\n')?;
            }
        }
        Ok(())
    }
}

/// Writes records as CSV, a line each, under a header of their fields' names; `name` is that of
/// their file.
pub(crate) fn records_csv<R: Serialize>(
    name: &str,
    records: impl IntoIterator<Item = R>,
) -> Result<String> {
    csv_text(name, |out| {
        records.into_iter().try_for_each(|r| out.serialize(r))
    })
}

fn csv_text(
    name: &str,
    write: impl FnOnce(&mut csv::Writer<Vec<u8>>) -> csv::Result<()>,
) -> Result<String> {
    let failed = |e: &dyn fmt::Display| Error::new(format!("{name}.csv: {e}"));
    let mut out = csv::Writer::from_writer(Vec::new());
    write(&mut out).map_err(|e| failed(&e))?;
    let bytes = out.into_inner().map_err(|e| failed(&e))?;
    String::from_utf8(bytes).map_err(|e| failed(&e))
}

/// Replaces what would break the table or reach the terminal raw: names come from files.
pub(crate) fn escaped(cell: &str) -> String {
    cell.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect::<String>()
        .replace('\\', "\\\\")
        .replace('|', "\\|")
}

/// Returns the number with `digits` digits after the point, or `n/a` for what was not measured.
pub(crate) fn figure(value: Option<f64>, digits: usize) -> String {
    match value {
        Some(value) => format!("{value:.digits$}"),
        None => NOT_MEASURED.to_owned(),
    }
}
