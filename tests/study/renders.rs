//! Renders side by side: where the box lies, what the page shows, and that its letters are there.

use gspotential::report::{GridRow, Window, method_grid, most_contested};
use gspotential::scene::Image;

/// Values without a pattern, the same every time.
fn noise(width: u32, height: u32, seed: u64) -> Image {
    let mut state = seed;
    let value = |_| {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    Image {
        width,
        height,
        rgb: (0..3 * width * height).map(value).collect(),
    }
}

/// The variance of the renders' mean squared errors in a window, in floats and pixel by pixel.
fn variance(truth: &Image, renders: &[&Image], window: Window) -> f64 {
    let error = |render: &&Image| {
        let mut sum = 0.0;
        for y in window.y..window.y + window.height {
            for x in window.x..window.x + window.width {
                for channel in 0..3 {
                    let at = (3 * (y * truth.width + x) + channel) as usize;
                    sum += (f64::from(render.rgb[at]) - f64::from(truth.rgb[at])).powi(2);
                }
            }
        }
        sum / f64::from(3 * window.width * window.height)
    };
    let errors: Vec<f64> = renders.iter().map(error).collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64
}

#[test]
fn the_box_is_where_errors_differ_most_by_brute_force() {
    for seed in 0..4 {
        let truth = noise(23, 14, seed);
        let renders: Vec<Image> = (1..4).map(|i| noise(23, 14, 100 * i + seed)).collect();
        let renders: Vec<&Image> = renders.iter().collect();
        let found = most_contested(&truth, &renders).expect("pictures of one size");
        assert_eq!((found.width, found.height), (5, 3));
        let (mut best, mut most) = (found, -1.0);
        for y in 0..=14 - 3 {
            for x in 0..=23 - 5 {
                let window = Window { x, y, ..found };
                let here = variance(&truth, &renders, window);
                if here > most {
                    (best, most) = (window, here);
                }
            }
        }
        assert_eq!(found, best, "{seed}");
    }
    // An error that all share is contested nowhere.
    let (truth, wrong) = (noise(8, 8, 1), noise(8, 8, 2));
    let found = most_contested(&truth, &[&wrong, &wrong]).expect("pictures");
    assert_eq!((found.x, found.y), (0, 0));
    assert!(most_contested(&truth, &[&noise(8, 9, 3)]).is_err());
}

#[test]
fn a_grid_shows_pictures_boxes_and_what_is_in_them() {
    let plain = |rgb: [u8; 3]| Image {
        width: 40,
        height: 20,
        rgb: rgb.repeat(800),
    };
    let (truth, good) = (plain([10, 20, 30]), plain([10, 20, 30]));
    let mut bad = good.clone();
    // Red in the columns from 30 and the rows from 15: the lower right window of 10 x 5.
    for y in 15..20 {
        for x in 30..40 {
            bad.rgb[3 * (40 * y + x)..][..3].copy_from_slice(&[200, 0, 0]);
        }
    }
    let row = GridRow {
        label: "scene, view".to_owned(),
        truth,
        renders: vec![(good, "30.00 dB".to_owned()), (bad, "20.00 dB".to_owned())],
    };
    let names = ["first".to_owned(), "second".to_owned()];
    let page = method_grid(&names, std::slice::from_ref(&row)).expect("a page");
    // 400 x 200 a picture, 8 apart; a line of text is 26 high.
    assert_eq!(
        (page.width, page.height),
        (8 + 3 * 408, 8 + 26 + 2 * 26 + 400 + 8)
    );
    let at = |x: u32, y: u32| -> [u8; 3] {
        let i = 3 * (y * page.width + x) as usize;
        page.rgb[i..i + 3].try_into().expect("three")
    };
    let (upper, lower) = (8 + 26 + 26, 8 + 26 + 26 + 200 + 26);
    let left = |i: u32| 8 + 408 * i;
    // The box around the red part, the part itself, and the part enlarged.
    assert_eq!(at(left(2) + 301, upper + 170), [240, 228, 66]);
    assert_eq!(at(left(2) + 350, upper + 175), [200, 0, 0]);
    assert_eq!(at(left(2) + 200, lower + 100), [200, 0, 0]);
    assert_eq!(at(left(1) + 200, lower + 100), [10, 20, 30]);
    assert_eq!(at(left(0) + 301, upper + 170), [240, 228, 66]);
    // Text: names above the columns, the view's label, figures beneath the renders alone.
    let ink = |x: u32, y: u32| {
        let pixels = (y..y + 18).flat_map(|y| (x..x + 400).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| at(x, y) == [0; 3]).count()
    };
    for i in 0..3 {
        assert!(ink(left(i), 8) > 100, "{i}");
    }
    assert!(ink(left(0), 34) > 100);
    assert_eq!(ink(left(0), lower - 22), 0);
    assert!(ink(left(1), lower - 22) > 100);
    assert!(ink(left(1), lower - 22) != ink(left(2), lower - 22));

    assert!(method_grid(&names, &[]).is_err());
    assert!(method_grid(&names[..1], &[row]).is_err());
}
