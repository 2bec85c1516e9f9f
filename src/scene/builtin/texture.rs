//! This module has procedural surface colours with detail at several scales.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::noise::{fractal_noise, lerp, random, smoothstep, value_noise};

/// What a surface is painted with; evaluated at points of the solid's own frame.
#[derive(Clone, Copy, Debug)]
pub(super) enum Texture {
    /// Oak boards along x, for a plane.
    Planks,
    /// Rings of glazed tiles around z.
    Mosaic,
    Marble,
    /// Growth rings around z.
    Wood,
    /// Dots on the faces of a box of this half size.
    Dots {
        half: f64,
    },
    /// Bands that climb around z.
    Spiral,
    /// Squares in longitude and latitude.
    Globe {
        a: DVec3,
        b: DVec3,
    },
    /// Segments around a ring of this major radius.
    Segments {
        major: f64,
    },
    /// Cloth covers above and below, paper at the sides, for a box of this half size.
    Book {
        half: DVec3,
        cover: DVec3,
    },
    /// A metal rod along z with dark bands.
    Brass,
    /// A soft gradient around the whole scene.
    Backdrop,
}

/// Returns the linear colour of an sRGB triple, by the gamma of 2 that rendering uses throughout.
pub(super) const fn color(r: u8, g: u8, b: u8) -> DVec3 {
    const fn linear(v: u8) -> f64 {
        (v as f64 / 255.0) * (v as f64 / 255.0)
    }
    DVec3::new(linear(r), linear(g), linear(b))
}

const CREAM: DVec3 = color(240, 228, 203);
const TEAL: DVec3 = color(28, 112, 118);
const NAVY: DVec3 = color(32, 52, 96);
const RUST: DVec3 = color(196, 84, 48);
const OCHRE: DVec3 = color(224, 164, 62);
const INK: DVec3 = color(36, 34, 40);

impl Texture {
    /// Returns the linear colour in `[0, 1]` at a point of the surface, in the solid's frame.
    pub(super) fn albedo(&self, p: DVec3) -> DVec3 {
        match *self {
            Texture::Planks => planks(p),
            Texture::Mosaic => mosaic(p),
            Texture::Marble => marble(p),
            Texture::Wood => wood(p),
            Texture::Dots { half } => dots(p, half),
            Texture::Spiral => spiral(p),
            Texture::Globe { a, b } => globe(p, a, b),
            Texture::Segments { major } => segments(p, major),
            Texture::Book { half, cover } => book(p, half, cover),
            Texture::Brass => {
                let band = 0.5 + 0.5 * (p.z * TAU / 0.14).sin();
                color(226, 178, 84).lerp(color(92, 58, 30), smoothstep(0.62, 0.72, band))
            }
            Texture::Backdrop => backdrop(p),
        }
    }
}

/// Returns 1 within `half_width` of an integer, 0 elsewhere, with a soft border.
fn line(x: f64, half_width: f64) -> f64 {
    let off = (x - x.round()).abs();
    1.0 - smoothstep(half_width * 0.7, half_width * 1.3, off)
}

/// Returns how far a floor point has faded into the backdrop, in `[0, 1]`: no hard horizon.
pub(super) fn floor_fade(p: DVec3) -> f64 {
    smoothstep(4.0, 9.0, DVec2::new(p.x, p.y).length())
}

fn planks(p: DVec3) -> DVec3 {
    const WIDTH: f64 = 0.34;
    const LENGTH: f64 = 2.3;
    let row = (p.y / WIDTH).floor();
    let shifted = p.x / LENGTH + random([row as i64, 0, 1]);
    let board = [row as i64, shifted.floor() as i64, 2];
    let offset = 40.0 * random(board);
    let stretched = DVec3::new(p.x * 1.3 + offset, p.y * 9.0, offset);
    let rings = fractal_noise(stretched, 3);
    let grain = value_noise(DVec3::new(p.x * 9.0, p.y * 130.0, offset));
    let tone = 0.5 * random([board[0], board[1], 3]) + 0.7 * (rings - 0.5) + 0.22 * (grain - 0.5);
    let wood = color(196, 158, 116).lerp(color(136, 96, 62), tone.clamp(0.0, 1.0));
    let gap = line(p.y / WIDTH, 0.016).max(line(shifted, 0.0024));
    let knot = smoothstep(
        0.76,
        0.86,
        value_noise(DVec3::new(p.x * 1.9, p.y * 4.0, offset)),
    );
    wood * (1.0 - 0.75 * gap) * (1.0 - 0.3 * knot)
}

/// Returns the colour where floor and backdrop meet, in the direction `azimuth`.
pub(super) fn horizon(azimuth: f64) -> DVec3 {
    let warm = 0.5 + 0.5 * (azimuth - 0.7).cos();
    color(176, 178, 190).lerp(color(214, 196, 174), warm)
}

fn backdrop(p: DVec3) -> DVec3 {
    let azimuth = p.y.atan2(p.x);
    let height = (p.z / p.length()).clamp(0.0, 1.0);
    let drapery = 0.5 + 0.25 * (3.0 * azimuth + 0.8).sin() + 0.25 * (5.0 * azimuth).sin();
    let above = color(108, 128, 160).lerp(color(138, 146, 168), drapery);
    horizon(azimuth).lerp(above, smoothstep(0.0, 0.6, height))
}

fn mosaic(p: DVec3) -> DVec3 {
    const RING: f64 = 0.105;
    const PALETTE: [DVec3; 4] = [NAVY, TEAL, CREAM, OCHRE];
    let grout = color(214, 204, 190);
    let rho = DVec2::new(p.x, p.y).length();
    let ring = (rho / RING).floor();
    let n_tiles = ((ring + 0.5) * TAU).round().max(1.0) as i64;
    let turn = p.y.atan2(p.x) / TAU + 0.5 + 0.37 * random([ring as i64, 5, 5]);
    let along = turn * n_tiles as f64;
    let tile = (along.floor() as i64).rem_euclid(n_tiles);
    let key = [ring as i64, tile, 11];
    // Rings of one colour carry rings of mixed ones between them.
    let mixed = (random(key) * 4.0) as usize;
    let base = match ring as i64 {
        3 | 9 => RUST,
        6 | 12 => PALETTE[(tile % 2) as usize * 2],
        13.. => NAVY,
        _ => PALETTE[mixed.min(3)],
    };
    let glaze = 0.78 + 0.3 * random([key[0], key[1], 12]);
    let mottle = 0.86 + 0.28 * fractal_noise(p * 26.0, 2);
    let joint = line(rho / RING, 0.06).max(line(along, 0.06 * RING * n_tiles as f64 / (TAU * rho)));
    (base * glaze * mottle).lerp(grout, joint).min(DVec3::ONE)
}

fn marble(p: DVec3) -> DVec3 {
    let warp = DVec3::new(
        fractal_noise(p * 3.0, 3),
        fractal_noise(p * 3.0 + DVec3::splat(31.0), 3),
        0.5,
    );
    let coarse = (9.0 * (p.x + 0.6 * p.y + 0.4 * p.z) + 7.0 * warp.x)
        .sin()
        .abs();
    let fine = (23.0 * (p.z - 0.5 * p.x) + 11.0 * warp.y).sin().abs();
    let veins =
        0.85 * (1.0 - smoothstep(0.0, 0.30, coarse)) + 0.5 * (1.0 - smoothstep(0.0, 0.22, fine));
    color(236, 232, 226)
        .lerp(color(176, 184, 198), smoothstep(0.35, 0.75, warp.x))
        .lerp(color(52, 62, 84), veins.min(1.0))
}

fn wood(p: DVec3) -> DVec3 {
    let wobble = fractal_noise(DVec3::new(p.x * 2.4, p.y * 2.4, p.z * 1.1), 2);
    let rings = (DVec2::new(p.x + 0.16, p.y - 0.07).length() + 0.16 * wobble) * 19.0;
    let ring = smoothstep(0.1, 0.95, rings.rem_euclid(1.0));
    let fiber = value_noise(DVec3::new(p.x * 60.0, p.y * 60.0, p.z * 5.0));
    color(218, 158, 92).lerp(color(122, 62, 30), 0.85 * ring) * (0.82 + 0.25 * fiber)
}

fn dots(p: DVec3, half: f64) -> DVec3 {
    let q = p / half;
    let a = q.abs();
    let (uv, side) = if a.z >= a.x && a.z >= a.y {
        (DVec2::new(q.x, q.y), 0.0)
    } else if a.x >= a.y {
        (DVec2::new(q.y, q.z), 1.0)
    } else {
        (DVec2::new(q.x, q.z), 2.0)
    };
    let grid = (uv + DVec2::ONE) * 2.0;
    let cell = grid.floor();
    let key = [cell.x as i64 * 7 + side as i64, cell.y as i64, 21];
    let radius = 0.2 + 0.14 * random(key);
    let off = (grid - cell).distance(DVec2::splat(0.5));
    let dot = 1.0 - smoothstep(radius - 0.03, radius + 0.03, off);
    let core = 1.0 - smoothstep(radius * 0.42 - 0.03, radius * 0.42 + 0.03, off);
    let weave = 0.84
        + 0.16 * (p * 95.0).to_array().map(f64::sin).iter().product::<f64>()
        + 0.12 * (fractal_noise(p * 14.0, 2) - 0.5);
    (RUST.lerp(CREAM, dot).lerp(TEAL, core) * weave).min(DVec3::ONE)
}

fn spiral(p: DVec3) -> DVec3 {
    let turn = p.y.atan2(p.x) / TAU;
    // Down the side and on over the top, where the radius changes instead of the height.
    let along = p.z - DVec2::new(p.x, p.y).length();
    let climb = along * 4.6 + turn;
    let band = climb.rem_euclid(1.0);
    let broad = smoothstep(0.0, 0.03, band) - smoothstep(0.5, 0.53, band);
    let thin = line(climb * 2.0 + 0.5, 0.075);
    let glaze = 0.86 + 0.24 * (fractal_noise(p * DVec3::new(9.0, 9.0, 20.0), 3) - 0.2);
    let lattice = line(turn * 24.0 - along * 12.0, 0.09) * broad;
    (CREAM
        .lerp(TEAL, broad)
        .lerp(OCHRE, 0.8 * lattice)
        .lerp(INK, thin)
        * glaze)
        .min(DVec3::ONE)
}

fn globe(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let longitude = (p.y.atan2(p.x) / TAU + 0.5) * 12.0;
    let latitude = (p.z / p.length()).clamp(-1.0, 1.0).acos() / PI * 7.0;
    let odd = (longitude.floor() + latitude.floor()).rem_euclid(2.0) >= 1.0;
    let base = if odd { a } else { b };
    let speckle = fractal_noise(p * 34.0, 2);
    base * lerp(0.74, 1.08, speckle)
}

fn segments(p: DVec3, major: f64) -> DVec3 {
    let turn = p.y.atan2(p.x) / TAU;
    let tube = p.z.atan2(DVec2::new(p.x, p.y).length() - major) / TAU;
    let along = turn * 14.0;
    let base = [OCHRE, NAVY][(along.floor() as i64).rem_euclid(2) as usize];
    let stitches = line(tube * 6.0 + along, 0.10);
    let seam = line(along, 0.07);
    let cloth = 0.8 + 0.3 * fractal_noise(p * 40.0, 2);
    (base.lerp(CREAM, 0.75 * stitches).lerp(INK, seam) * cloth).min(DVec3::ONE)
}

fn book(p: DVec3, half: DVec3, cover: DVec3) -> DVec3 {
    let q = p / half;
    let board = 1.0 - 0.014 / half.z;
    let is_spine = q.x < -0.96;
    if q.z.abs() < board && !is_spine {
        let leaf = 0.5 + 0.5 * (p.z * TAU / 0.011 + 2.0 * value_noise(p * 12.0)).sin();
        return color(232, 222, 196) * (0.72 + 0.28 * leaf);
    }
    let cloth = 0.82 + 0.3 * fractal_noise(p * DVec3::new(60.0, 60.0, 30.0), 2);
    if is_spine {
        let title = line(q.y * 3.0, 0.12) * (1.0 - smoothstep(0.5, 0.7, q.z.abs()));
        return cover.lerp(OCHRE, title) * cloth;
    }
    // A gilt frame and a lozenge on the cover.
    let rim = 1.0 - q.x.abs().max(q.y.abs());
    let frame = 1.0 - smoothstep(0.02, 0.035, (rim - 0.16).abs());
    let lozenge = q.x.abs() / 0.4 + q.y.abs() / 0.5;
    let mark = 1.0 - smoothstep(0.06, 0.1, (lozenge - 0.9).abs());
    let center = 1.0 - smoothstep(0.42, 0.48, lozenge);
    (cover * cloth).lerp(OCHRE, frame.max(mark).max(center))
}
