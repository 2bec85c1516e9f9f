//! Errors by pixel and what takes them away: planted exposure changes, colour casts and shifts.

use gspotential::metrics::errors::{ColourFit, edges, fitted_error, fitted_psnr, squared_errors};
use gspotential::scene::Image;

use super::noise;

/// An image whose every pixel has the colour that `of` says.
fn painted(width: u32, height: u32, of: impl Fn(u32, u32) -> [u8; 3]) -> Image {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    Image {
        width,
        height,
        rgb: pixels.flat_map(|(x, y)| of(x, y)).collect(),
    }
}

/// `image` moved to the right and down; its border is drawn out.
fn shifted(image: &Image, right: u32, down: u32) -> Image {
    painted(image.width, image.height, |x, y| {
        let (x, y) = (x.saturating_sub(right), y.saturating_sub(down));
        let i = 3 * (y * image.width + x) as usize;
        [image.rgb[i], image.rgb[i + 1], image.rgb[i + 2]]
    })
}

fn whole(render: &Image, photograph: &Image, reach: usize) -> f64 {
    let errors = squared_errors(render, photograph, reach).expect("a pair");
    errors.iter().sum()
}

#[test]
fn the_error_of_a_pixel_is_that_which_psnr_adds_up() {
    let (render, photograph) = (noise(7, 5, 1), noise(7, 5, 2));
    let errors = squared_errors(&render, &photograph, 0).expect("a pair");
    let pairs = render.rgb.chunks(3).zip(photograph.rgb.chunks(3));
    for (error, (a, b)) in errors.iter().zip(pairs) {
        let squares = a
            .iter()
            .zip(b)
            .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
        assert_eq!(*error, squares.sum::<f64>());
    }
    let mse = whole(&render, &photograph, 0) / (255.0 * 255.0 * 105.0);
    let psnr = gspotential::metrics::psnr(&render, &photograph).expect("a pair");
    assert!((psnr + 10.0 * mse.log10()).abs() < 1e-12, "{psnr}");
}

#[test]
fn a_planted_shift_vanishes_within_the_window_that_reaches_it_and_colours_do_not() {
    let photograph = noise(24, 16, 3);
    let render = shifted(&photograph, 2, 1);
    let [none, one, two] = [0, 1, 2].map(|reach| whole(&render, &photograph, reach));
    assert!(one > 0.1 * none, "{one} of {none}");
    // What has left the picture at the right and below cannot be found.
    let errors = squared_errors(&render, &photograph, 2).expect("a pair");
    for (i, error) in errors.iter().enumerate() {
        let (x, y) = (i % 24, i / 24);
        assert!(x >= 22 || y >= 15 || *error == 0.0, "{x} {y}: {error}");
    }
    assert!(two < 0.05 * none, "{two} of {none}");
    // By brute force, at a border and within.
    let at = |x: usize, y: usize| &render.rgb[3 * (24 * y + x)..][..3];
    for (x, y) in [(0, 0), (23, 15), (10, 0), (11, 9)] {
        let own = &photograph.rgb[3 * (24 * y + x)..][..3];
        let mut least = f64::INFINITY;
        for row in y.saturating_sub(1)..=(y + 1).min(15) {
            for column in x.saturating_sub(1)..=(x + 1).min(23) {
                let pairs = at(column, row).iter().zip(own);
                let error = pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
                least = least.min(error);
            }
        }
        let found = squared_errors(&render, &photograph, 1).expect("a pair")[24 * y + x];
        assert_eq!(found, least, "{x} {y}");
    }
    // A plain area that is too dark stays so, however wide the window.
    let (plain, dark) = (painted(9, 9, |_, _| [90; 3]), painted(9, 9, |_, _| [80; 3]));
    assert_eq!(whole(&dark, &plain, 2), 81.0 * 300.0);
}

#[test]
fn a_planted_exposure_change_is_found_by_the_fit_of_its_kind_alone() {
    let photograph = noise(20, 12, 4);
    let changed = |of: &dyn Fn([f64; 3]) -> [f64; 3]| {
        painted(20, 12, |x, y| {
            let i = 3 * (20 * y + x) as usize;
            of([0, 1, 2].map(|c| f64::from(photograph.rgb[i + c]))).map(|v| v.round() as u8)
        })
    };
    let left = |render: &Image, fit| {
        let error = fitted_error(render, &photograph, fit).expect("a pair");
        error / whole(render, &photograph, 0)
    };
    // Rounding alone is left of a gain and an offset.
    let exposed = changed(&|[r, g, b]| [0.8 * r + 20.0, 0.9 * g + 5.0, 0.5 * b]);
    let gains = left(&exposed, ColourFit::Gains);
    assert!(gains < 1e-3, "{gains}");
    let matrix = left(&exposed, ColourFit::Matrix);
    assert!(matrix <= gains, "{matrix}");
    // A mix of channels takes the matrix.
    let mixed = changed(&|[r, g, b]| [0.6 * r + 0.3 * g, 0.6 * g + 0.3 * b, 0.6 * b + 0.3 * r]);
    let (gains, matrix) = (
        left(&mixed, ColourFit::Gains),
        left(&mixed, ColourFit::Matrix),
    );
    assert!(gains > 0.1 && matrix < 1e-3, "{gains} {matrix}");
    let as_it_is = gspotential::metrics::psnr(&mixed, &photograph).expect("a pair");
    let fitted = fitted_psnr(&mixed, &photograph).expect("a pair");
    assert!(as_it_is < 25.0 && fitted > 50.0, "{as_it_is} {fitted}");
    // A shift is no exposure.
    let moved = shifted(&photograph, 1, 0);
    assert!(left(&moved, ColourFit::Matrix) > 0.4);
    // A render of one colour, or of grey, has no channels to tell apart.
    let plain = painted(20, 12, |_, _| [50, 60, 70]);
    let spread = fitted_error(&plain, &photograph, ColourFit::Gains).expect("a pair");
    let matrix = fitted_error(&plain, &photograph, ColourFit::Matrix).expect("a pair");
    assert!(spread > 0.0 && (matrix - spread).abs() < 1e-6 * spread);
    let grey = changed(&|[r, _, _]| [r; 3]);
    let (gains, matrix) = (
        left(&grey, ColourFit::Gains),
        left(&grey, ColourFit::Matrix),
    );
    assert!((gains - matrix).abs() < 1e-9, "{gains} {matrix}");
}

#[test]
fn edges_are_the_steepest_pixels_and_a_plain_photograph_has_none() {
    // Black, then white from column 6 on: the step lies between columns 5 and 6.
    let step = painted(12, 10, |x, _| [if x < 6 { 0 } else { 255 }; 3]);
    let found = edges(&step, 0.8).expect("an image");
    for (i, is_edge) in found.iter().enumerate() {
        assert_eq!(*is_edge, (5..7).contains(&(i % 12)), "{i}");
    }
    let plain = painted(12, 10, |_, _| [7; 3]);
    assert!(!edges(&plain, 0.8).expect("an image").contains(&true));
    let one = painted(1, 1, |_, _| [7; 3]);
    assert_eq!(edges(&one, 0.8).expect("an image"), [false]);
    let count = edges(&noise(20, 20, 5), 0.8).expect("an image");
    let n = count.iter().filter(|edge| **edge).count();
    assert!((75..=80).contains(&n), "{n}");
}

#[test]
fn images_of_two_sizes_have_no_errors() {
    let (a, b) = (noise(4, 3, 1), noise(3, 4, 1));
    assert!(squared_errors(&a, &b, 0).is_err());
    assert!(fitted_error(&a, &b, ColourFit::Gains).is_err());
}
