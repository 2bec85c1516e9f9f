//! Checkpoint files: what is kept, and what damage does.

use std::fs;
use std::path::{Path, PathBuf};

use gspotential::error::{Error, Result};
use gspotential::run::Checkpoints;

type Header = Vec<String>;

fn header(done: u32) -> Header {
    vec![format!("after {done}")]
}

fn payload(done: u32) -> Vec<Vec<u8>> {
    (0..3).map(|i| vec![done as u8 + i; 1000]).collect()
}

fn save(store: &Checkpoints, done: u32) {
    let parts = payload(done).into_iter().map(Ok);
    store.save(done, &header(done), parts).expect("written");
}

/// The iteration of the newest that can be read, and the warnings.
fn newest(store: &Checkpoints) -> Result<Option<(u32, Vec<String>)>> {
    let Some(found) = store.newest::<Header>()? else {
        return Ok(None);
    };
    let done: u32 = found.header[0]
        .strip_prefix("after ")
        .and_then(|n| n.parse().ok())
        .expect("a header");
    assert_eq!(found.payload, payload(done).concat());
    Ok(Some((done, found.warnings)))
}

struct Fixture {
    _folder: tempfile::TempDir,
    root: PathBuf,
    store: Checkpoints,
}

fn store() -> Fixture {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("checkpoints");
    fs::create_dir(&root).expect("a folder");
    Fixture {
        store: Checkpoints::new(root.clone()),
        root,
        _folder: folder,
    }
}

fn names(root: &Path) -> Vec<String> {
    let entries = fs::read_dir(root).expect("a folder");
    let mut names: Vec<String> = entries
        .map(|e| {
            e.expect("an entry")
                .file_name()
                .into_string()
                .expect("a name")
        })
        .collect();
    names.sort();
    names
}

#[test]
fn the_newest_two_are_kept_and_later_ones_that_were_fallen_back_from_go() {
    let fixture = store();
    let (root, store) = (&fixture.root, &fixture.store);
    fs::remove_dir(root).expect("empty");
    assert!(newest(store).expect("no folder is no fault").is_none());
    let error = store.save(1, &header(1), std::iter::empty()).unwrap_err();
    assert!(error.to_string().contains("0000000001.ckpt"), "{error}");
    fs::create_dir(root).expect("a folder");
    for done in [5, 90, 1000, 4_000_000_000] {
        save(store, done);
        assert_eq!(newest(store).expect("readable"), Some((done, Vec::new())));
    }
    assert_eq!(names(root), ["0000001000.ckpt", "4000000000.ckpt"]);
    fs::write(root.join("notes.txt"), "mine").expect("written");
    save(store, 2000);
    assert_eq!(
        names(root),
        ["0000001000.ckpt", "0000002000.ckpt", "notes.txt"]
    );
    save(store, 2000);
    assert_eq!(newest(store).expect("readable"), Some((2000, Vec::new())));
}

#[test]
fn any_damage_falls_back_to_the_one_before_and_says_so() {
    let fixture = store();
    let (root, store) = (&fixture.root, &fixture.store);
    save(store, 10);
    save(store, 20);
    let path = root.join("0000000020.ckpt");
    let whole = fs::read(&path).expect("readable");
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        bytes
    };
    let n = whole.len();
    let damaged = [0, 7, 9, 13, 19, 22, n / 2, n - 5, n - 4, n - 1].map(flipped);
    let cut = [0, 1, 19, 23, n / 2, n - 1].map(|len| whole[..len].to_vec());
    for bytes in damaged
        .into_iter()
        .chain(cut)
        .chain([[&whole[..], &[0]].concat()])
    {
        fs::write(&path, &bytes).expect("written");
        let (done, warnings) = newest(store).expect("readable").expect("one is left");
        assert_eq!((done, warnings.len()), (10, 1));
        assert!(warnings[0].contains("0000000020.ckpt: "), "{warnings:?}");
    }
    fs::write(&path, &whole).expect("written");
    assert_eq!(newest(store).expect("readable"), Some((20, Vec::new())));

    // If nothing can be read, the newest's fault is told.
    fs::write(&path, &whole[..50]).expect("written");
    fs::write(root.join("0000000010.ckpt"), "").expect("written");
    let error = newest(store).unwrap_err().to_string();
    assert!(
        error.contains("0000000020.ckpt: damaged") && error.contains("train the run again"),
        "{error}"
    );
}

#[test]
fn another_format_or_header_is_told_from_damage() {
    let fixture = store();
    let (root, store) = (&fixture.root, &fixture.store);
    save(store, 10);
    let path = root.join("0000000010.ckpt");
    let mut bytes = fs::read(&path).expect("readable");
    bytes[8] = 2;
    fs::write(&path, bytes).expect("written");
    let error = newest(store).unwrap_err().to_string();
    assert!(
        error.contains("format 2; this version reads format 1"),
        "{error}"
    );
    store
        .save(10, &"no list", std::iter::empty())
        .expect("written");
    let error = newest(store).unwrap_err().to_string();
    assert!(error.contains("not as this version writes it"), "{error}");
}

#[test]
fn a_write_that_fails_leaves_what_was_there() {
    let fixture = store();
    let (root, store) = (&fixture.root, &fixture.store);
    save(store, 10);
    let fault = || Err(Error::new("the GPU is gone"));
    let parts = [Ok(vec![1; 100]), fault()].into_iter();
    let error = store.save(20, &header(20), parts).unwrap_err();
    assert_eq!(error.to_string(), "the GPU is gone");
    assert_eq!(names(root), ["0000000010.ckpt"]);
    // What a killed process leaves half-written.
    fs::write(root.join("0000000020.ckpt.part"), "x").expect("written");
    assert_eq!(newest(store).expect("readable"), Some((10, Vec::new())));
    store.tidy().expect("removed");
    assert_eq!(names(root), ["0000000010.ckpt"]);
    store.clear().expect("removed");
    assert!(!root.exists());
    store.clear().expect("nothing to remove");
}
