//! This module writes a study's tables, each as Markdown, CSV and JSON from the same cells.

use serde_json::{Map, Value, json};

use crate::error::{Error, Result};
use crate::report::stats::Figure;
use crate::terminal::Table;

/// A column: its name in files, its heading on paper.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Name of the column in CSV and JSON.
    pub key: &'static str,
    /// Heading in Markdown.
    pub heading: &'static str,
    /// Digits after the point; `None` for text.
    pub digits: Option<usize>,
}

impl Column {
    /// Returns a column of words.
    pub const fn text(key: &'static str, heading: &'static str) -> Column {
        Column {
            key,
            heading,
            digits: None,
        }
    }

    /// Returns a column of numbers, with `digits` after the point in Markdown.
    pub const fn figure(key: &'static str, heading: &'static str, digits: usize) -> Column {
        Column {
            key,
            heading,
            digits: Some(digits),
        }
    }
}

/// A cell of a row, under a column of its kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Words, shown as they are.
    Text(String),
    /// A number with its spread; `None` if it was not measured.
    Figure(Option<Figure>),
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
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

/// Rows of cells under columns.
#[derive(Clone, Debug)]
pub struct DataTable {
    /// Name of its files.
    pub name: String,
    /// From left to right.
    pub columns: Vec<Column>,
    /// From top to bottom; each has one cell a column.
    pub rows: Vec<Vec<Cell>>,
}

impl DataTable {
    /// Returns a table without rows.
    pub fn new(name: &str, columns: &[Column]) -> DataTable {
        DataTable {
            name: name.to_owned(),
            columns: columns.to_vec(),
            rows: Vec::new(),
        }
    }

    /// Appends a row, which has one cell a column.
    pub fn row(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// Writes the table for people: figures as `mean ± deviation`.
    pub fn to_markdown(&self) -> String {
        let headings: Vec<&str> = self.columns.iter().map(|column| column.heading).collect();
        let n_text = self.columns.iter().take_while(|c| c.digits.is_none());
        let mut table = Table::with_text(n_text.count(), &headings);
        for row in &self.rows {
            let cells = row.iter().zip(&self.columns);
            let cells: Vec<String> = cells.map(|(cell, column)| printed(cell, column)).collect();
            table.row(&cells);
        }
        table.to_string()
    }

    /// Writes the table for programs: figures in full, each followed by its standard deviation in a
    /// column `KEY_deviation`.
    pub fn to_csv(&self) -> Result<String> {
        let failed = |e: &dyn std::fmt::Display| Error::new(format!("{}.csv: {e}", self.name));
        let mut out = csv::Writer::from_writer(Vec::new());
        let header = self.columns.iter().flat_map(|column| match column.digits {
            Some(_) => vec![column.key.to_owned(), format!("{}_deviation", column.key)],
            None => vec![column.key.to_owned()],
        });
        out.write_record(header).map_err(|e| failed(&e))?;
        let number = |value: Option<f64>| value.map_or(String::new(), |v| v.to_string());
        for row in &self.rows {
            let record = row.iter().flat_map(|cell| match cell {
                Cell::Text(text) => vec![text.clone()],
                Cell::Figure(figure) => vec![
                    number(figure.map(|f| f.mean)),
                    number(figure.and_then(|f| f.deviation)),
                ],
            });
            out.write_record(record).map_err(|e| failed(&e))?;
        }
        let bytes = out.into_inner().map_err(|e| failed(&e))?;
        String::from_utf8(bytes).map_err(|e| failed(&e))
    }

    /// Writes the table as JSON, one object a row.
    pub fn to_json(&self) -> Value {
        let object = |row: &Vec<Cell>| -> Value {
            let cells = row.iter().zip(&self.columns);
            let values = cells.map(|(cell, column)| {
                let value = match cell {
                    Cell::Text(text) => json!(text),
                    Cell::Figure(figure) => json!(figure),
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

fn printed(cell: &Cell, column: &Column) -> String {
    let digits = column.digits.unwrap_or(0);
    match cell {
        Cell::Text(text) => text.clone(),
        Cell::Figure(None) => "n/a".to_owned(),
        Cell::Figure(Some(Figure { mean, deviation })) => match deviation {
            Some(deviation) => format!("{mean:.digits$} ± {deviation:.digits$}"),
            None => format!("{mean:.digits$}"),
        },
    }
}
