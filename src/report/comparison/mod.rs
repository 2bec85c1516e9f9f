//! A comparison sets several runs in one table: methods by scene, as papers print them.
//!
//! Runs stand in one block, and compare, where the test images are the same: scene, image size
//! and test views. In a block, runs of one method and the same settings are seeds of one row.

mod markdown;
mod run;

pub use run::ComparedRun;

use crate::error::{Error, Result};
use crate::metrics::Renders;
use crate::report::stats::Figure;
use crate::scene::PoseProtocol;

/// Training views that a row's label names; more are counted.
const MAX_NAMED: usize = 4;

/// Runs grouped into scenes and rows, in the order of their first appearance.
#[derive(Debug)]
pub struct Comparison<'a> {
    /// All that are compared, in the order in which they were given.
    pub runs: &'a [ComparedRun],
    /// One for each scene with its set of test images.
    pub blocks: Vec<Block<'a>>,
}

/// The rows of one set of test images.
#[derive(Debug)]
pub struct Block<'a> {
    /// `garden (320x213, 20 test views)`.
    pub scene: String,
    /// One for each method with its settings.
    pub rows: Vec<Row<'a>>,
}

/// The runs of one method and the same settings, which differ in their seeds.
#[derive(Debug)]
pub struct Row<'a> {
    /// The method, and those settings in which the compared runs differ.
    pub label: String,
    /// One for each seed.
    pub runs: Vec<&'a ComparedRun>,
}

/// Refuses runs whose test cameras came into the frame in different ways; each is given by name.
pub fn check_protocols<'a>(runs: impl IntoIterator<Item = (&'a str, PoseProtocol)>) -> Result<()> {
    let mut runs = runs.into_iter();
    let Some((first, protocol)) = runs.next() else {
        return Ok(());
    };
    match runs.find(|(_, other)| *other != protocol) {
        Some((name, other)) => Err(Error::new(format!(
            "test cameras are {protocol} in `{first}` but {other} in `{name}`: their figures do \
             not compare"
        ))
        .way_out("evaluate runs of each kind in a table of their own")),
        None => Ok(()),
    }
}

impl<'a> Comparison<'a> {
    /// Groups evaluated runs.
    ///
    /// # Errors
    /// No run, or runs whose figures do not compare: pose protocols or renders' rounding differ.
    pub fn new(runs: &'a [ComparedRun]) -> Result<Comparison<'a>> {
        check_protocols(
            runs.iter()
                .map(|run| (run.name(), run.measured().pose_protocol)),
        )?;
        let renders: Option<Renders> = runs.first().map(|run| run.measured().renders);
        if runs.is_empty()
            || runs
                .iter()
                .any(|run| Some(run.measured().renders) != renders)
        {
            return Err(Error::new("no runs that were measured in the same way")
                .way_out("evaluate them together"));
        }
        let mut blocks: Vec<Block> = Vec::new();
        for runs in grouped(runs.iter(), |a, b| a.same_images(b)) {
            let mut scene = runs[0].scene_label();
            let n_alike = blocks
                .iter()
                .filter(|block| block.rows[0].runs[0].scene_label() == scene)
                .count();
            if n_alike > 0 {
                scene += &format!(" [{}]", n_alike + 1);
            }
            blocks.push(Block {
                scene,
                rows: rows(runs),
            });
        }
        let mut comparison = Comparison { runs, blocks };
        comparison.label_rows();
        Ok(comparison)
    }

    /// Returns whether all runs agree in a setting.
    fn agree<T: PartialEq>(&self, setting: impl Fn(&'a ComparedRun) -> T) -> bool {
        let mut values = self.runs.iter().map(setting);
        let first = values.next();
        values.all(|value| Some(value) == first)
    }

    /// Writes into the labels what tells rows apart.
    fn label_rows(&mut self) {
        let same_iterations = self.agree(ComparedRun::iterations);
        let same_points = self.agree(|run| run.config.scene.max_points);
        for block in &mut self.blocks {
            let views: Vec<&[String]> = block.rows.iter().map(|row| row.train_views()).collect();
            let same_views = views.iter().all(|other| other == &views[0]);
            for row in &mut block.rows {
                let run = row.runs[0];
                row.label.clone_from(&run.method);
                if !same_iterations {
                    row.label += &format!(", {}", run.iterations());
                }
                if !same_points {
                    row.label += &format!(", {}", run.points());
                }
                if !same_views {
                    row.label += &format!(", {}", trained_on(row.train_views()));
                }
                if run.metrics.scene.n_test_trained > 0 {
                    row.label += ", trained on its test views, too";
                }
            }
            tell_apart(&mut block.rows);
        }
    }

    /// Returns the labels that have a row in every block; none if a scene is here twice, in other
    /// sizes or with other test views, or there is only one.
    pub fn labels_of_all(&self) -> Vec<&str> {
        let source = |block: &Block<'a>| &block.rows[0].runs[0].metrics.scene.source;
        let repeats = |i: usize| {
            let before = &self.blocks[..i];
            before.iter().any(|b| source(b) == source(&self.blocks[i]))
        };
        if self.blocks.len() < 2 || (0..self.blocks.len()).any(repeats) {
            return Vec::new();
        }
        let labels = self.blocks[0].rows.iter().map(|row| row.label.as_str());
        labels
            .filter(|label| {
                let mut rest = self.blocks.iter();
                rest.all(|block| block.row(label).is_some())
            })
            .collect()
    }
}

impl<'a> Block<'a> {
    fn row(&self, label: &str) -> Option<&Row<'a>> {
        self.rows.iter().find(|row| row.label == label)
    }
}

impl<'a> Row<'a> {
    fn train_views(&self) -> &'a [String] {
        &self.runs[0].metrics.scene.train_views
    }

    /// Returns mean and deviation of `value` over the row's runs; `None` if a run lacks it.
    pub fn figure(&self, value: impl Fn(&ComparedRun) -> Option<f64>) -> Option<Figure> {
        Figure::of(self.runs.iter().map(|run| value(run)))
    }
}

/// Returns the rows of a block, without labels. Runs of one seed are not seeds of one row: they
/// would make its spread look small.
fn rows(runs: Vec<&ComparedRun>) -> Vec<Row<'_>> {
    let row = |runs| Row {
        label: String::new(),
        runs,
    };
    let groups = grouped(runs.into_iter(), |a, b| a.same_row(b));
    groups
        .into_iter()
        .flat_map(|runs| {
            let repeats = |i: usize| {
                runs[..i]
                    .iter()
                    .any(|r| r.config.seed == runs[i].config.seed)
            };
            if (0..runs.len()).any(repeats) {
                runs.into_iter().map(|run| row(vec![run])).collect()
            } else {
                vec![row(runs)]
            }
        })
        .collect()
}

/// Adds the run's name to labels that are not alone.
fn tell_apart(rows: &mut [Row]) {
    let labels: Vec<String> = rows.iter().map(|row| row.label.clone()).collect();
    for row in rows {
        if labels.iter().filter(|label| **label == row.label).count() > 1 {
            row.label += &format!(" [{}]", row.runs[0].name());
        }
    }
}

fn trained_on(views: &[String]) -> String {
    if views.len() <= MAX_NAMED {
        format!("trained on {}", views.join(" "))
    } else {
        format!("{} training views", views.len())
    }
}

/// Groups items that are `alike`, in the order of their first appearance.
fn grouped<'a, T>(
    items: impl Iterator<Item = &'a T>,
    alike: impl Fn(&T, &T) -> bool,
) -> Vec<Vec<&'a T>> {
    let mut groups: Vec<Vec<&T>> = Vec::new();
    for item in items {
        match groups.iter_mut().find(|group| alike(group[0], item)) {
            Some(group) => group.push(item),
            None => groups.push(vec![item]),
        }
    }
    groups
}
