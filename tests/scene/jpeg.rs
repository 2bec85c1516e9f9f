//! JPEGs that are cut off.

use super::build::{Folder, SIZE, encoded, warns};
use image::ImageFormat;

const NAMES: [&str; 4] = ["a.png", "b.png", "c.png", "d.png"];
const END: [u8; 2] = [0xff, 0xd9];

/// Pictures of 120x80 pixels: progressive, with halved colours; progressive with restart markers;
/// sequential with restart markers.
const PROGRESSIVE: &[u8] = include_bytes!("../fuzz/corpus/image-jpeg/progressive");
const PROGRESSIVE_RESTARTS: &[u8] =
    include_bytes!("../fuzz/corpus/image-jpeg/progressive-restarts");
const RESTARTS: &[u8] = include_bytes!("../fuzz/corpus/image-jpeg/restarts");

/// What is said of a scene with this photograph: an error, or nothing.
fn said(jpeg: &[u8]) -> Option<String> {
    let folder = Folder::with_views(&NAMES);
    folder.write("images/c.png", jpeg);
    folder.load().err().map(|e| e.to_string())
}

/// The places of the markers of a kind that lie between scans.
fn places(jpeg: &[u8], marker: u8) -> Vec<usize> {
    let pairs = jpeg.windows(2).enumerate();
    pairs
        .filter(|(_, pair)| *pair == [0xff, marker])
        .map(|(at, _)| at)
        .collect()
}

#[test]
fn a_jpeg_that_is_cut_off_is_refused_and_one_with_something_behind_it_is_not() {
    let whole = encoded(SIZE.0, SIZE.1, ImageFormat::Jpeg);
    // A thumbnail of its own, with an end marker, in a segment of the whole.
    let mut nested = whole[..2].to_vec();
    nested.extend([0xff, 0xe1]);
    nested.extend(((whole.len() + 2) as u16).to_be_bytes());
    nested.extend(&whole);
    nested.extend(&whole[2..]);
    let mut trailed = whole.clone();
    trailed.extend(b"a video, say");
    for good in [&whole, &nested, &trailed] {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/c.png", good);
        warns(&folder.scene(), &[]);
    }
    let zeros = [0; 40];
    for bad in [
        whole[..whole.len() - 2].to_vec(),
        whole[..whole.len() - 20].to_vec(),
        nested[..nested.len() - 20].to_vec(),
        [&whole[..whole.len() - 40], &zeros[..]].concat(),
    ] {
        let folder = Folder::with_views(&NAMES);
        folder.write("images/c.png", bad);
        folder.fails_with(&["c.png: the JPEG is cut off", "end marker"]);
    }
}

#[test]
fn whole_jpegs_of_every_kind_are_silent() {
    let sequential = encoded(120, 80, ImageFormat::Jpeg);
    for jpeg in [&sequential, PROGRESSIVE, PROGRESSIVE_RESTARTS, RESTARTS] {
        let trailed = [jpeg, b"a video, say"].concat();
        assert_eq!(said(jpeg), None);
        assert_eq!(said(&trailed), None);
    }
}

#[test]
fn a_sequential_jpeg_that_was_closed_after_a_cut_anywhere_is_refused() {
    let sequential = encoded(120, 80, ImageFormat::Jpeg);
    for jpeg in [&sequential[..], RESTARTS] {
        let scan = places(jpeg, 0xda)[0] + 14;
        for at in (scan..jpeg.len() - 2).step_by(jpeg.len() / 50) {
            // Not between the bytes of a marker, or of a stuffed 0xff: that would be another damage.
            if jpeg[at - 1] == 0xff {
                continue;
            }
            let error = said(&[&jpeg[..at], &END[..]].concat()).unwrap_or_default();
            let cut = error.contains("c.png: the JPEG is cut off: scan 1 ends after");
            assert!(cut, "at {at}: {error:?}");
        }
    }
}

#[test]
fn a_progressive_jpeg_that_was_closed_within_a_scan_is_refused() {
    for jpeg in [PROGRESSIVE, PROGRESSIVE_RESTARTS] {
        let scans = places(jpeg, 0xda);
        assert!(scans.len() > 6, "{} scans", scans.len());
        for (i, scan) in scans.iter().enumerate() {
            let n = usize::from(jpeg[scan + 4]);
            let data = scan + 2 + 6 + 2 * n;
            // Up to the tables of the next scan; cut after a third and before the last byte.
            let next = (data..jpeg.len() - 1)
                .find(|at| jpeg[*at] == 0xff && !matches!(jpeg[at + 1], 0 | 0xd0..=0xd7));
            let end = next.expect("an end");
            for at in [data + (end - data) / 3, end - 1] {
                if at <= data || jpeg[at - 1] == 0xff {
                    continue;
                }
                let error = said(&[&jpeg[..at], &END[..]].concat()).unwrap_or_default();
                let cut = error.contains(&format!("scan {} ends after", i + 1));
                assert!(cut, "scan {i} at {at}: {error:?}");
            }
        }
    }
}

#[test]
fn a_jpeg_of_which_a_colour_or_a_part_in_the_middle_is_missing_is_refused() {
    // Two restart intervals less.
    let restarts: Vec<usize> = (0xd0..=0xd7).flat_map(|m| places(RESTARTS, m)).collect();
    assert!(restarts.len() >= 6);
    let mut sorted = restarts.clone();
    sorted.sort_unstable();
    let less = [&RESTARTS[..sorted[1]], &RESTARTS[sorted[3]..]].concat();
    assert!(said(&less).is_some_and(|e| e.contains("is cut off")));
    // A grey picture whose header tells of two colours more.
    let mut grey = std::io::Cursor::new(Vec::new());
    let picture = image::DynamicImage::from(super::build::picture(SIZE.0, SIZE.1));
    let written = picture.into_luma8().write_to(&mut grey, ImageFormat::Jpeg);
    written.expect("an encoded picture");
    let mut grey = grey.into_inner();
    assert_eq!(said(&grey), None);
    let frame = places(&grey, 0xc0)[0];
    assert_eq!((grey[frame + 3], grey[frame + 9]), (11, 1));
    (grey[frame + 3], grey[frame + 9]) = (17, 3);
    let colour = |id: u8| [id, 0x11, 0];
    assert!(!(0..2).any(|i| grey[frame + 10] == 40 + i));
    grey.splice(frame + 13..frame + 13, [colour(40), colour(41)].concat());
    let error = said(&grey).unwrap_or_default();
    assert!(
        error.contains("2 of its 3 colours are in no scan"),
        "{error}"
    );
}
