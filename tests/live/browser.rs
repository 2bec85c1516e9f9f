//! The page in headless Chromium, as it follows a training.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use gspotential::gaussians::Gaussians;
use gspotential::live::{Live, Phase};
use image::RgbImage;
use image::imageops::crop_imm;

use super::shown::{look, page};
use crate::page::ball;
use crate::page::browser::headless;
use crate::page::content::HOSTILE;

/// A green ball at the focus.
fn green() -> Gaussians {
    Gaussians {
        sh: vec![-1.7, 1.7, -1.7],
        ..ball()
    }
}

/// Trains for a browser that is about to come: its first question is answered before there is
/// anything to draw, and the end comes after it.
fn train(live: &Live) {
    live.ends(20);
    look(live, 10);
    let start = Instant::now();
    while !live.is_due() {
        assert!(start.elapsed() < Duration::from_secs(120), "nobody looks");
        thread::sleep(Duration::from_millis(2));
    }
    live.show(20, ball(), Duration::ZERO);
    look(live, 20);
    live.phase(Phase::Finished);
}

/// Opens the page of a training and returns its document once it has ended.
fn document_after_training(folder: &Path, live: &Live) -> String {
    thread::scope(|scope| {
        scope.spawn(|| train(live));
        let opened = headless(folder)
            .args(["--virtual-time-budget=20000", "--dump-dom"])
            .arg(live.address())
            .output()
            .expect("starts");
        String::from_utf8(opened.stdout).expect("text")
    })
}

fn picture_of(folder: &Path, live: &Live) -> RgbImage {
    let path = folder.join("page.png");
    headless(folder)
        .args(["--virtual-time-budget=8000", "--window-size=900,3000"])
        .arg(format!("--screenshot={}", path.display()))
        .arg(live.address())
        .output()
        .expect("starts");
    image::open(path).expect("a picture").into_rgb8()
}

fn n_pixels(picture: &RgbImage, is_so: impl Fn([u8; 3]) -> bool) -> usize {
    picture.pixels().filter(|pixel| is_so(pixel.0)).count()
}

#[test]
#[ignore = "needs Chromium"]
fn a_training_is_followed_in_a_browser() {
    let folder = tempfile::tempdir().expect("a folder");
    let live = page(HOSTILE);
    let document = document_after_training(folder.path(), &live);
    for part in [
        "data-model=\"20\"",
        "Finished.",
        ">20/20<",
        ">0.2500<",
        "Gaussians after 20 iterations: all 1.",
    ] {
        assert!(document.contains(part), "{part}: {document}");
    }
    // Loss and size; nothing of a name is run.
    assert_eq!(document.matches("<svg").count(), 2, "{document}");
    assert!(document.contains("<title>run - gspotential"), "{document}");
}

#[test]
#[ignore = "needs Chromium"]
fn the_newest_gaussians_are_drawn_beside_the_photographs() {
    let folder = tempfile::tempdir().expect("a folder");
    let live = page("t.png");
    live.show(10, ball(), Duration::ZERO);
    live.phase(Phase::Finished);
    let is_red = |[r, g, b]: [u8; 3]| r > 200 && g < 40 && b < 40;
    let is_green = |[r, g, b]: [u8; 3]| g > 200 && r < 40 && b < 40;
    let is_blue = |[r, g, b]: [u8; 3]| b > 180 && r < 40 && g < 40;
    let before = picture_of(folder.path(), &live);
    // The ball in the scene and in three views, the photographs beside them.
    assert!(
        n_pixels(&before, is_red) > 2000,
        "{}",
        n_pixels(&before, is_red)
    );
    assert!(
        n_pixels(&before, is_blue) > 6000,
        "{}",
        n_pixels(&before, is_blue)
    );
    let views = below_scene(&before, is_blue);
    assert!(
        n_pixels(&views, is_red) > 100,
        "{}",
        n_pixels(&views, is_red)
    );
    assert_eq!(n_pixels(&before, is_green), 0);
    live.show(20, green(), Duration::ZERO);
    let after = picture_of(folder.path(), &live);
    assert_eq!(n_pixels(&after, is_red), 0);
    assert!(n_pixels(&after, is_green) > 2000);
}

/// The part of a page from the first photograph on.
fn below_scene(page: &RgbImage, is_photograph: impl Fn([u8; 3]) -> bool) -> RgbImage {
    let shows = |y: &u32| (0..page.width()).any(|x| is_photograph(page.get_pixel(x, *y).0));
    let from = (0..page.height()).find(shows).expect("a photograph");
    crop_imm(page, 0, from, page.width(), page.height() - from).to_image()
}
