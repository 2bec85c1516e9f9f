//! The split decides which views are trained on and which are tested.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec3;
use serde::Deserialize;

use super::images::Matched;
use super::layout::NamedSplit;
use super::{LoadOptions, Scene, View};
use crate::error::{Error, Result, without_mark};
use crate::files::bytes::read_regular;

/// The shortest sequence that counts as a loop.
const MIN_LOOP: usize = 8;
/// The greatest median step of a loop, as a share of how far it leads away from its first camera.
const MAX_STEP: f64 = 0.4;

/// Indices of the views, in the order of the list or the protocol that chose them.
#[derive(Debug)]
pub(super) struct Split {
    pub train: Vec<usize>,
    pub test: Vec<usize>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SplitFile {
    train: Vec<String>,
    test: Option<Vec<String>>,
}

/// Chooses the views. Training views are those of `options.train_views`, else of `split.json`, else
/// of the format's `own` split, else `n_train` uniformly over the sorted names, the ends among
/// them; where the sequence closes, uniformly around it, since its first and last view are
/// neighbours. Test views are those of `options.test_views`, else of `split.json` or else `own`,
/// else up to `n_test` uniformly over the sorted names of the rest (the paper's protocol).
///
/// # Errors
///
/// No training view; a view named for training or in the options that is unknown, without pose
/// or image, or listed twice; views in both lists, unless the options allow it; a `split.json` that is none. Test views of
/// the file that cannot be used are counted in `warnings`.
pub(super) fn choose(
    dir: &Path,
    matched: &Matched,
    own: Option<NamedSplit>,
    options: &LoadOptions,
    warnings: &mut Vec<String>,
) -> Result<Split> {
    let listed = match read_split(&dir.join("split.json"))? {
        None => own,
        file => file,
    };
    let place = listed.as_ref().map(|l| l.place.clone()).unwrap_or_default();
    let in_list = |e: Error| e.at_path(&place);
    let file_name = place.file_name().unwrap_or_default().to_string_lossy();

    let train = if let Some(names) = &options.train_views {
        let names = joined(names, |name| matched.knows(name));
        training_views(&names, matched, Error::usage)?
    } else if let Some(listed) = &listed {
        training_views(&listed.train, matched, Error::new).map_err(in_list)?
    } else {
        if options.n_train == 0 {
            return Err(Error::usage("0 training views asked for").way_out("train on at least 1"));
        }
        let sorted = sorted_by_name(matched, &[]);
        if sorted.len() < options.n_train {
            warnings.push(format!(
                "only {} posed images for {} training views: all are trained on",
                sorted.len(),
                options.n_train
            ));
        }
        let centers: Vec<DVec3> = sorted
            .iter()
            .map(|i| matched.views[*i].posed.camera.center())
            .collect();
        match closes(&centers) {
            true => around(&sorted, options.n_train),
            false => uniform(&sorted, options.n_train),
        }
    };

    let test = match (&options.test_views, listed.and_then(|listed| listed.test)) {
        (Some(names), _) => {
            let names = joined(names, |name| matched.knows(name));
            let test = named_views(&names, "test", matched, Error::usage)?;
            let both = test.iter().find(|i| train.contains(i));
            if let (Some(&i), false) = (both, options.overlap) {
                return Err(in_both(&matched.views[i].posed.camera.name));
            }
            test
        }
        (None, Some(names)) => {
            let mut test = test_views(&names, &file_name, matched, warnings);
            let both = test.iter().filter(|i| train.contains(i)).count();
            if both > 0 && options.train_views.is_none() {
                let what = format!("{both} views are in both `train` and `test`");
                return Err(in_list(Error::new(what).way_out("list each view once")));
            }
            if both > 0 {
                test.retain(|i| !train.contains(i));
                warnings.push(format!(
                    "{both} test views of `{file_name}` are trained on and so not tested"
                ));
            }
            test
        }
        (None, None) => uniform(&sorted_by_name(matched, &train), options.n_test),
    };
    Ok(Split { train, test })
}

/// Most pieces of a list that one name with commas is put together from.
const MAX_PIECES: usize = 8;

/// Returns the names of a list that was parted at its commas, of which names may have some
/// themselves: each is the longest run of pieces that is known, or else a piece.
fn joined(pieces: &[String], is_known: impl Fn(&str) -> bool) -> Vec<String> {
    let mut names = Vec::with_capacity(pieces.len());
    let mut rest = pieces;
    while !rest.is_empty() {
        let ends = 1..=rest.len().min(MAX_PIECES);
        let known = ends.rev().find(|&n| is_known(&rest[..n].join(",")));
        let (name, behind) = rest.split_at(known.unwrap_or(1));
        names.push(name.join(","));
        rest = behind;
    }
    names
}

fn read_split(path: &Path) -> Result<Option<NamedSplit>> {
    if !path.exists() {
        return Ok(None);
    }
    let file: SplitFile =
        serde_json::from_slice(without_mark(&read_regular(path)?)).map_err(|e| {
            Error::new(format!("not a split file: {e}"))
                .at_path(path)
                .way_out("write {\"train\": [\"a.jpg\", ...], \"test\": [\"b.jpg\", ...]}")
        })?;
    Ok(Some(NamedSplit {
        train: file.train,
        test: file.test,
        place: path.to_owned(),
    }))
}

fn in_both(name: &str) -> Error {
    Error::usage(format!(
        "view `{}` is named for training and for testing",
        name.escape_debug()
    ))
    .way_out("name it once")
}

/// Splits a scene that is loaded whole by the names in `options`, where it has any: training
/// views that are not named are left out, test views that are trained on, too.
///
/// # Errors
///
/// A name that no view has or that is given twice, or no training view.
pub(super) fn regroup(scene: &mut Scene, options: &LoadOptions) -> Result<()> {
    let all = [scene.train.clone(), scene.test.clone()].concat();
    let find = |names: &[String], role: &str| -> Result<Vec<View>> {
        let mut chosen: Vec<View> = Vec::with_capacity(names.len());
        for name in names {
            let known = || all.iter().map(|view| view.camera.name.as_str());
            let fault =
                |what: &str| Error::usage(format!("{role} view `{}` {what}", name.escape_debug()));
            if chosen.iter().any(|view| view.camera.name == *name) {
                return Err(fault("is named twice").way_out("name each view once"));
            }
            let Some(i) = known().position(|other| other == name) else {
                return Err(fault("is not in the scene").way_out(near_misses(name, known())));
            };
            chosen.push(all[i].clone());
        }
        Ok(chosen)
    };
    if let Some(names) = &options.train_views {
        if names.is_empty() {
            return Err(no_training_view(Error::usage));
        }
        scene.train = find(names, "training")?;
    } else {
        if scene.train.len() < options.n_train {
            scene.warnings.push(format!(
                "only {} views for training of {}: all are trained on",
                scene.train.len(),
                options.n_train
            ));
        }
        scene.train = uniform(&scene.train, options.n_train);
    }
    let trained = |name: &str| scene.train.iter().any(|view| view.camera.name == name);
    match &options.test_views {
        Some(names) => {
            let both = names.iter().find(|name| trained(name));
            if let (Some(name), false) = (both, options.overlap) {
                return Err(in_both(name));
            }
            scene.test = find(names, "test")?;
        }
        None => scene.test.retain(|view| !trained(&view.camera.name)),
    }
    Ok(())
}

fn no_training_view(error: fn(String) -> Error) -> Error {
    error("no training view is named".to_owned()).way_out("name at least one")
}

fn training_views(
    names: &[String],
    matched: &Matched,
    error: fn(String) -> Error,
) -> Result<Vec<usize>> {
    if names.is_empty() {
        return Err(no_training_view(error));
    }
    named_views(names, "training", matched, error)
}

/// Finds the views named, all of which must be usable; `error` decides whose fault it is if not.
fn named_views(
    names: &[String],
    role: &str,
    matched: &Matched,
    error: fn(String) -> Error,
) -> Result<Vec<usize>> {
    let mut chosen = Vec::with_capacity(names.len());
    for name in names {
        let fault = |what: &str| error(format!("{role} view `{}` {what}", name.escape_debug()));
        let Some(index) = matched.index(name) else {
            return Err(if matched.without_image.contains(name) {
                fault("has a pose but no image").way_out("put the image into `images/`")
            } else if matched.without_pose.contains(name) {
                fault("has an image but no pose").way_out("pose it, or choose another view")
            } else {
                let known = matched.by_name.keys().map(String::as_str);
                fault("is not in the scene").way_out(near_misses(name, known))
            });
        };
        if chosen.contains(&index) {
            return Err(fault("is named twice").way_out("name each view once"));
        }
        chosen.push(index);
    }
    Ok(chosen)
}

/// Finds the views named in the file `place` that can be used.
fn test_views(
    names: &[String],
    place: &str,
    matched: &Matched,
    warnings: &mut Vec<String>,
) -> Vec<usize> {
    let mut seen = BTreeSet::new();
    let mut chosen = Vec::new();
    let mut unusable = Vec::new();
    let mut n_repeated = 0;
    for name in names {
        match matched.index(name) {
            None => unusable.push(name),
            Some(index) if seen.insert(index) => chosen.push(index),
            Some(_) => n_repeated += 1,
        }
    }
    if let Some(example) = unusable.first() {
        warnings.push(format!(
            "{} test views of `{place}` have no posed image and are left out: `{}`{}",
            unusable.len(),
            example.escape_debug(),
            if unusable.len() > 1 { ", ..." } else { "" }
        ));
    }
    if n_repeated > 0 {
        warnings.push(format!(
            "{n_repeated} test views of `{place}` are named again: used once"
        ));
    }
    chosen
}

/// Returns the indices of the views that are not in `without`, by their names' byte order.
fn sorted_by_name(matched: &Matched, without: &[usize]) -> Vec<usize> {
    let mut rest: Vec<usize> = (0..matched.views.len())
        .filter(|i| !without.contains(i))
        .collect();
    rest.sort_by(|&a, &b| {
        let name = |i: usize| &matched.views[i].posed.camera.name;
        name(a).cmp(name(b))
    });
    rest
}

/// Returns `n` of `items` at the indices `round(i (N - 1) / (n - 1))`, all where there are no more.
pub(super) fn uniform<T: Clone>(items: &[T], n: usize) -> Vec<T> {
    if n >= items.len() {
        return items.to_vec();
    }
    if n < 2 {
        return items[..n].to_vec();
    }
    let last = items.len() - 1;
    let steps = n - 1;
    (0..n)
        .map(|i| items[(2 * i * last + steps) / (2 * steps)].clone())
        .collect()
}

/// Returns `n` of `items` in a circle at the indices `floor(i N / n)`, all where there are no more.
fn around<T: Clone>(items: &[T], n: usize) -> Vec<T> {
    if n >= items.len() {
        return items.to_vec();
    }
    (0..n).map(|i| items[i * items.len() / n].clone()).collect()
}

/// Returns whether a sequence of camera centres is a closed loop: its last camera is a neighbour of
/// its first.
///
/// That is, the step between them is at most twice the median step of the sequence, and the median
/// step at most 0.4 of the sequence's diameter, as in a circle of 8 or more: in photographs without
/// an order, which says nothing of neighbours, it is half of it. Fewer than 8 views are no loop.
fn closes(centers: &[DVec3]) -> bool {
    let (Some(first), Some(last)) = (centers.first(), centers.last()) else {
        return false;
    };
    if centers.len() < MIN_LOOP {
        return false;
    }
    let mut steps: Vec<f64> = centers.windows(2).map(|w| w[0].distance(w[1])).collect();
    let middle = steps.len() / 2;
    let median = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    // The farthest from the first is at least half the diameter away, in a circle the whole.
    let reach = centers
        .iter()
        .map(|c| c.distance(*first))
        .fold(0.0, f64::max);
    // Cameras that all stand in one place have no order either.
    median > 0.0 && first.distance(*last) <= 2.0 * median && median <= MAX_STEP * reach
}

/// Names up to three of `known` that `name` may have been meant as, as a way out.
fn near_misses<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    // The distance takes time and memory in both lengths; nobody mistypes a whole page.
    let mut ranked: Vec<(usize, &str)> = known
        .filter(|candidate| name.len().max(candidate.len()) <= 256)
        .map(|candidate| (strsim::damerau_levenshtein(name, candidate), candidate))
        .collect();
    ranked.sort_unstable();
    let close: Vec<String> = ranked
        .iter()
        .take_while(|(distance, _)| *distance <= (name.chars().count() / 2).max(2))
        .take(3)
        .map(|(_, candidate)| format!("`{candidate}`"))
        .collect();
    match (close.as_slice(), ranked.first()) {
        ([], Some((_, candidate))) => format!("views are named like `{candidate}`"),
        ([], None) => "name posed images of the scene".to_owned(),
        _ => format!("did you mean {}?", close.join(", ")),
    }
}
