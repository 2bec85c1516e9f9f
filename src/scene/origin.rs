//! This module reads which view each point of a cloud came from, by the word of the cloud's file.

use std::collections::BTreeMap;
use std::path::Path;

use ply_rs::ply::ElementDef;

use super::formats::own_cloud;
use super::ply::read_views;
use crate::error::{Error, Result};
use crate::files::ply::{MAX_HEADER_BYTES, read_header};
use crate::files::{read_file, read_start};

/// What a header's comment begins with that names a view: `comment view NUMBER NAME`.
const COMMENT: &str = "comment view ";

/// The views that the points of a cloud came from.
pub(super) struct Origin {
    /// The number of each point's view, from 0.
    views: Vec<u32>,
    /// Photographs of those numbers, as far as the file names them.
    names: BTreeMap<u32, String>,
}

impl Origin {
    /// Reads the property `view` and the names of the views; `None` where the file has none.
    ///
    /// # Errors
    /// A PLY that cannot be read, a `view` that is no whole number from 0.
    pub(super) fn read(path: &Path) -> Result<Option<Origin>> {
        let extension = path.extension();
        if extension.is_none_or(|e| !e.eq_ignore_ascii_case("ply")) {
            return Ok(None);
        }
        let here = |e: Error| e.at_path(path);
        // Most clouds say nothing: their header suffices.
        let head = read_start(path, MAX_HEADER_BYTES)?;
        let header = read_header(&head).map_err(here)?;
        let has_views = |element: &ElementDef| element.properties.contains_key("view");
        if !header.elements.get("vertex").is_some_and(has_views) {
            return Ok(None);
        }
        let names = names(&String::from_utf8_lossy(&head[..header.end]));
        let views = read_views(&read_file(path)?).map_err(here)?;
        Ok(views.map(|views| Origin { views, names }))
    }

    /// Tells of each point whether it came from one of the first `n` views: of the first of the
    /// training views `train` where the file names its views.
    pub(super) fn of_first(&self, n: usize, train: &[&str]) -> Vec<bool> {
        let first: Vec<u32> = self.of_training(train).into_iter().take(n).collect();
        let is_first = |view: &u32| match self.names.is_empty() {
            true => (*view as usize) < n,
            false => first.contains(view),
        };
        self.views.iter().map(is_first).collect()
    }

    /// Tells of each point whether it came from none of the test views `test`; points whose view has no
    /// name did not.
    pub(super) fn of_no_test_view(&self, test: &[&str]) -> Vec<bool> {
        let is_test = |view: &u32| {
            let name = self.names.get(view);
            name.is_some_and(|name| test.contains(&name.as_str()))
        };
        let tests: Vec<u32> = self.names.keys().copied().filter(is_test).collect();
        self.views.iter().map(|v| !tests.contains(v)).collect()
    }

    /// Numbers of the training views that the file names, in order.
    fn of_training(&self, train: &[&str]) -> Vec<u32> {
        let named = self.names.iter();
        named
            .filter(|(_, name)| train.contains(&name.as_str()))
            .map(|(number, _)| *number)
            .collect()
    }
}

/// Returns the number of views that the points of the COLMAP scene `dir` came from, by their own word, of the
/// training views `train` alone where the file names its views; 0 where it does not say.
///
/// # Errors
/// A cloud that cannot be read.
pub fn n_cloud_views(dir: &Path, train: &[&str]) -> Result<usize> {
    let origin = own_cloud(dir)
        .map(|cloud| Origin::read(&cloud))
        .transpose()?;
    Ok(origin
        .flatten()
        .map_or(0, |origin| match origin.names.is_empty() {
            true => origin
                .views
                .iter()
                .max()
                .map_or(0, |last| *last as usize + 1),
            false => origin.of_training(train).len(),
        }))
}

/// Lines of a PLY header that name views by their numbers, from 0.
pub(super) fn comments(names: &[&str]) -> String {
    let lines = names.iter().enumerate();
    // A line break within a name would end the comment.
    lines
        .filter(|(_, name)| !name.contains(char::is_control))
        .map(|(number, name)| format!("{COMMENT}{number} {name}\n"))
        .collect()
}

fn names(header: &str) -> BTreeMap<u32, String> {
    let named = header.lines().filter_map(|line| {
        let (number, name) = line.strip_prefix(COMMENT)?.split_once(' ')?;
        Some((number.parse().ok()?, name.to_owned()))
    });
    named.collect()
}

/// Tells of each point whether a scene takes it: whether it came from one of the `first` views, or from no
/// test view if none are asked for. `None` if the file does not say where its points came from.
///
/// # Errors
/// Usage: `first` views of a file that does not say where its points came from.
pub(super) fn kept(
    path: &Path,
    first: Option<usize>,
    (train, test): (&[&str], &[&str]),
) -> Result<Option<Vec<bool>>> {
    let origin = Origin::read(path)?;
    match (first, origin) {
        (Some(n), Some(origin)) => Ok(Some(origin.of_first(n, train))),
        (Some(_), None) => Err(
            Error::usage("the points do not say which view they came from")
                .at_path(path)
                .way_out("`gspotential scene` writes clouds that do; or name a cloud file"),
        ),
        (None, origin) => Ok(origin.map(|origin| origin.of_no_test_view(test))),
    }
}
