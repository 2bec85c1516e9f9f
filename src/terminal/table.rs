//! This module writes Markdown tables.

use std::fmt::{self, Write as _};

/// A Markdown table. The first columns, text, are aligned to the left, the others, figures, to
/// the right.
#[derive(Clone, Debug)]
pub struct Table {
    n_text: usize,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Returns a table whose first column is text.
    pub fn new(header: &[&str]) -> Table {
        Table::with_text(1, header)
    }

    /// Returns a table whose first `n_text` columns are text.
    pub fn with_text(n_text: usize, header: &[&str]) -> Table {
        Table {
            n_text,
            rows: vec![header.iter().map(|&cell| cell.to_owned()).collect()],
        }
    }

    /// Appends a row; cells beyond the header's are left out, missing ones are empty.
    pub fn row(&mut self, cells: &[String]) {
        let mut row = cells.to_vec();
        row.resize(self.rows[0].len(), String::new());
        self.rows.push(row);
    }

    /// Returns the header and the rows, as they came.
    pub fn rows(&self) -> &[Vec<String>] {
        &self.rows
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let escape = |row: &Vec<String>| row.iter().map(|cell| escaped(cell)).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().map(escape).collect();
        let n_columns = rows[0].len();
        let widths: Vec<usize> = (0..n_columns)
            .map(|column| {
                let widths = rows.iter().map(|row| row[column].chars().count());
                widths.max().unwrap_or(0).max(3)
            })
            .collect();
        for (i, row) in rows.iter().enumerate() {
            f.write_char('|')?;
            for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                if column < self.n_text {
                    write!(f, " {cell:width$} |")?;
                } else {
                    write!(f, " {cell:>width$} |")?;
                }
            }
            f.write_char('\n')?;
            if i == 0 {
                f.write_char('|')?;
                for (column, &width) in widths.iter().enumerate() {
                    if column < self.n_text {
                        write!(f, "{}|", "-".repeat(width + 2))?;
                    } else {
                        write!(f, "{}:|", "-".repeat(width + 1))?;
                    }
                }
                f.write_char('\n')?;
            }
        }
        Ok(())
    }
}

/// Names come from files: what would break the table or reach the terminal raw is replaced.
pub(crate) fn escaped(cell: &str) -> String {
    cell.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect::<String>()
        .replace('\\', "\\\\")
        .replace('|', "\\|")
}

/// Returns the figure with `digits` after the point, or `n/a` for what was not measured.
pub(crate) fn figure(value: Option<f64>, digits: usize) -> String {
    match value {
        Some(value) => format!("{value:.digits$}"),
        None => "n/a".to_owned(),
    }
}
