//! Tiny scenes, written by code of the tests' own.

use std::path::Path;

use gspotential::config::Config;
use gspotential::error::{Error, ErrorKind};
use gspotential::scene::{self, LoadOptions, Scene};
use image::{ImageFormat, Rgb, RgbImage};
use tempfile::TempDir;

/// Width and height of the photographs and cameras.
pub(crate) const SIZE: (u32, u32) = (12, 8);

pub(crate) const CAMERAS_TXT: &str = "# cameras\n1 PINHOLE 12 8 10 11 6.5 3.5\n";

/// A scene folder that is removed with the value.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn empty() -> Self {
        Folder(TempDir::new().expect("a temporary folder"))
    }

    /// A good scene: one shared text PINHOLE camera, views on a line, three points.
    pub(crate) fn with_views(names: &[&str]) -> Self {
        let folder = Self::empty();
        folder.write("sparse/0/cameras.txt", CAMERAS_TXT);
        folder.write("sparse/0/images.txt", images_txt(names));
        folder.write("sparse/0/points3D.ply", GOOD_PLY);
        for name in names {
            folder.write(&format!("images/{name}"), png(SIZE.0, SIZE.1));
        }
        folder
    }

    pub(crate) fn path(&self) -> &Path {
        self.0.path()
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path().join(name);
        let parent = path.parent().expect("a path within the folder");
        std::fs::create_dir_all(parent).expect("a folder");
        std::fs::write(path, bytes).expect("a file");
    }

    pub(crate) fn remove(&self, name: &str) {
        std::fs::remove_file(self.path().join(name)).expect("a file to remove");
    }

    pub(crate) fn load(&self) -> Result<Scene, Error> {
        self.load_with(&options())
    }

    pub(crate) fn load_with(&self, options: &LoadOptions) -> Result<Scene, Error> {
        scene::load(self.path(), options)
    }

    /// Loads what must load.
    #[track_caller]
    pub(crate) fn scene(&self) -> Scene {
        self.load().unwrap_or_else(|e| panic!("{e}"))
    }

    /// Asserts that loading fails in one line that holds every one of `parts`.
    #[track_caller]
    pub(crate) fn fails_with(&self, parts: &[&str]) {
        fails_with(self.load(), ErrorKind::Failure, parts);
    }
}

#[track_caller]
pub(crate) fn fails_with<T>(result: Result<T, Error>, kind: ErrorKind, parts: &[&str]) {
    let error = result.err().expect("an error");
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
    assert!(!text.contains('\n'), "more than a line: {text}");
    assert!(text.len() < 1000, "too long: {text}");
    assert_eq!(error.kind(), kind, "{text}");
}

/// Asserts that the scene's warnings are exactly these, each given by a part of it.
#[track_caller]
pub(crate) fn warns(scene: &Scene, parts: &[&str]) {
    let matches = scene.warnings.len() == parts.len()
        && scene.warnings.iter().zip(parts).all(|(w, p)| w.contains(p));
    assert!(matches, "{:?} are not {parts:?}", scene.warnings);
}

pub(crate) fn options() -> LoadOptions {
    let config = Config::preset("paper").expect("a preset");
    LoadOptions::new(&config)
}

/// Cameras that look along +z from (index, 0, 0).
pub(crate) fn images_txt(names: &[&str]) -> String {
    let line = |(i, name): (usize, &&str)| format!("{} 1 0 0 0 -{i} 0 0 1 {name}\n\n", i + 1);
    names.iter().enumerate().map(line).collect()
}

/// Three points; the last is red.
pub(crate) const GOOD_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\n\
    property float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n\
    0 0 5 1 2 3\n1 0 6 4 5 6\n-1 2 7 255 0 0\n";

/// [`GOOD_PLY`] with other rows.
pub(crate) fn ply_with_rows(rows: &[&str]) -> String {
    let header = GOOD_PLY.split_inclusive('\n').take(10).collect::<String>();
    let header = header.replace("vertex 3", &format!("vertex {}", rows.len()));
    header + &rows.join("\n") + "\n"
}

/// A picture that differs in every pixel.
pub(crate) fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([(17 * x) as u8, (23 * y) as u8, (x * y + 40) as u8])
    })
}

pub(crate) fn png(width: u32, height: u32) -> Vec<u8> {
    encoded(width, height, ImageFormat::Png)
}

pub(crate) fn encoded(width: u32, height: u32, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture(width, height)
        .write_to(&mut bytes, format)
        .expect("an encoded picture");
    bytes.into_inner()
}
