//! Filled holes against a reference in f64.

use gspotential::cloud::splat::{SplatImage, fill_holes};
use gspotential::doctor::twin::random::Random;

const WEIGHT: u8 = 77;

/// Covered pixels in random colours between 40 and 200, everything else empty.
fn image(width: u32, height: u32, mut is_covered: impl FnMut(u32, u32) -> bool) -> SplatImage {
    let mut random = Random::new(u64::from(width * 1000 + height));
    let (mut rgba, mut depths) = (Vec::new(), Vec::new());
    for y in 0..height {
        for x in 0..width {
            let color = [(); 3].map(|()| random.uniform(40.0, 200.0) as u8);
            let [r, g, b] = color;
            let is_covered = is_covered(x, y);
            rgba.extend(if is_covered { [r, g, b, 255] } else { [0; 4] });
            let depth = random.uniform(1.0, 1.5) as f32;
            depths.push(if is_covered { depth } else { 0.0 });
        }
    }
    SplatImage {
        width,
        height,
        rgba,
        depths,
    }
}

/// Colour times weight, weight, and depth times weight, row by row.
type Plane = Vec<Vec<[f64; 5]>>;

/// Pull-push by recursion; weights of the result are 1.
fn reference(level: &Plane) -> Plane {
    let (height, width) = (level.len(), level[0].len());
    if width == 1 && height == 1 {
        return vec![vec![level[0][0].map(|v| v / level[0][0][3])]];
    }
    let mut coarse = vec![vec![[0.0; 5]; width.div_ceil(2)]; height.div_ceil(2)];
    for (y, row) in coarse.iter_mut().enumerate() {
        for (x, sum) in row.iter_mut().enumerate() {
            let four = [(0, 0), (0, 1), (1, 0), (1, 1)];
            let pixels = four.map(|(v, u)| level.get(2 * y + v).and_then(|r| r.get(2 * x + u)));
            let covered = || pixels.iter().flatten().filter(|pixel| pixel[3] > 0.0);
            let depth = |pixel: &[f64; 5]| pixel[4] / pixel[3];
            let farthest = covered().map(|pixel| depth(pixel)).fold(0.0, f64::max);
            for pixel in covered() {
                let share = (depth(pixel) / farthest).powi(16);
                (0..5).for_each(|i| sum[i] += share * pixel[i]);
            }
            let weight: f64 = covered().map(|pixel| pixel[3]).sum();
            if weight > 0.0 {
                *sum = sum.map(|v| v / sum[3] * weight.min(1.0));
            }
        }
    }
    let coarse = reference(&coarse);
    // Centres of fine pixels in coarse pixels, with the two coarse ones around and their shares.
    let around = |v: usize, n: usize| {
        let at = (v as f64 + 0.5) / 2.0 - 0.5;
        let low = at.floor();
        let clamped = |k: f64| k.clamp(0.0, n as f64 - 1.0) as usize;
        [
            (clamped(low), 1.0 - (at - low)),
            (clamped(low + 1.0), at - low),
        ]
    };
    let enlarged = |x: usize, y: usize| -> [f64; 5] {
        let (rows, columns) = (around(y, coarse.len()), around(x, coarse[0].len()));
        let four = rows.map(|(row, a)| columns.map(|(column, b)| (a * b, coarse[row][column])));
        let farthest = four.concat().iter().map(|(_, p)| p[4]).fold(0.0, f64::max);
        let mut sum = [0.0; 5];
        for (share, pixel) in four.concat() {
            let share = share * (pixel[4] / farthest).powi(16);
            (0..5).for_each(|i| sum[i] += share * pixel[i]);
        }
        sum.map(|v| v / sum[3])
    };
    let complete = |x: usize, y: usize| {
        let (pixel, enlarged) = (level[y][x], enlarged(x, y));
        std::array::from_fn(|i| pixel[i] + (1.0 - pixel[3]) * enlarged[i])
    };
    (0..height)
        .map(|y| (0..width).map(|x| complete(x, y)).collect())
        .collect()
}

/// Pixels of the image whose colour is not the reference's, to half a step and rounding.
fn n_off(image: &SplatImage, filled: &[u8]) -> usize {
    let level: Plane = image
        .rgba
        .chunks_exact(4 * image.width as usize)
        .zip(image.depths.chunks_exact(image.width as usize))
        .map(|(row, depths)| {
            let pixels = row.chunks_exact(4).zip(depths);
            let pixel = |(p, depth): (&[u8], &f32)| {
                let [r, g, b, weight] = [p[0], p[1], p[2], p[3] / 255].map(f64::from);
                [r, g, b, weight, f64::from(*depth)]
            };
            pixels.map(pixel).collect()
        })
        .collect();
    let reference = reference(&level).concat();
    let is_off = |(ours, exact): &(&[u8], &[f64; 5])| {
        (0..3).any(|i| (f64::from(ours[i]) - exact[i]).abs() > 0.5001)
    };
    filled
        .chunks_exact(4)
        .zip(&reference)
        .filter(is_off)
        .count()
}

#[test]
fn holes_are_filled_as_the_reference_fills_them() {
    let mut random = Random::new(8);
    for (width, height) in [(1, 1), (2, 1), (1, 9), (7, 5), (33, 17), (64, 48), (5, 70)] {
        for share in [0.03, 0.5, 0.97] {
            let image = image(width, height, |x, y| {
                (x, y) == (width / 2, 0) || random.uniform(0.0, 1.0) < share
            });
            let filled = fill_holes(&image, WEIGHT);
            assert_eq!(n_off(&image, &filled), 0, "{width}x{height}, {share}");
            // The comparison sees one pixel that is off.
            let mut altered = filled.clone();
            altered[0] += 2;
            assert_eq!(n_off(&image, &altered), 1, "{width}x{height}, {share}");
            for (before, after) in image.rgba.chunks_exact(4).zip(filled.chunks_exact(4)) {
                match before[3] {
                    0 => assert_eq!(after[3], WEIGHT),
                    _ => assert_eq!(before, after),
                }
            }
        }
    }
}

#[test]
fn fills_stay_within_the_colours_around_and_go_smoothly_across() {
    // Left edge 50, right edge 200: in between the fill only rises.
    let mut edges = image(64, 8, |x, _| x == 0 || x == 63);
    edges.depths.fill(1.0);
    for (i, pixel) in edges.rgba.chunks_exact_mut(4).enumerate() {
        let value = [50, 200][usize::from(i % 64 > 0)];
        if pixel[3] > 0 {
            pixel[..3].fill(value);
        }
    }
    let filled = fill_holes(&edges, WEIGHT);
    let row: Vec<u8> = filled[..4 * 64].chunks_exact(4).map(|p| p[0]).collect();
    assert!(row.is_sorted(), "{row:?}");
    assert_eq!((row[0], row[63]), (50, 200));
    let steps = row.windows(2).map(|pair| pair[1] - pair[0]);
    assert!(steps.max() < Some(40), "{row:?}");
}

#[test]
fn a_hole_beside_an_edge_of_depth_takes_the_colour_of_what_lies_behind() {
    // A near object, 200, before a ground, 50, with a hole between them.
    let mut edge = image(64, 8, |x, _| !(20..44).contains(&x));
    for (i, pixel) in edge.rgba.chunks_exact_mut(4).enumerate() {
        if pixel[3] > 0 {
            pixel[..3].fill([50, 200][usize::from(i % 64 < 20)]);
        }
    }
    let middle = |depths: [f32; 2]| {
        let mut edge = edge.clone();
        for (i, depth) in edge.depths.iter_mut().enumerate() {
            *depth = depths[usize::from(i % 64 < 20)];
        }
        fill_holes(&edge, WEIGHT)[4 * (4 * 64 + 30)]
    };
    let (behind, alike, before) = (middle([2.0, 1.0]), middle([1.0, 1.0]), middle([1.0, 2.0]));
    assert!(behind < 70, "{behind}, {alike}, {before}");
    assert!((90..160).contains(&alike), "{behind}, {alike}, {before}");
    assert!(before > 180, "{behind}, {alike}, {before}");
}

#[test]
fn an_image_without_a_covered_pixel_stays_empty() {
    let empty = image(6, 3, |_, _| false);
    assert_eq!(fill_holes(&empty, WEIGHT), empty.rgba);
}
