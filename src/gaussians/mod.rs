//! This module has the Gaussians on the host: the model, its start from a point cloud, and its
//! files ([`ply`], [`splat`], [`spz`], [`sog`], [`gltf`]).

mod format;
pub mod gltf;
mod placed;
pub mod ply;
mod sh;
pub mod sog;
pub mod splat;
pub mod spz;

pub use format::Format;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::GeomWithData;

use crate::camera::Frame;
use crate::config::ModelConfig;
use crate::error::{Error, Result};
use crate::scene::PointCloud;

/// Degree-0 spherical harmonic, `1 / (2 sqrt(pi))`: colour = 0.5 + `SH_0` * `f_dc` + ...
pub const SH_0: f64 = 0.28209479177387814;

/// Highest spherical-harmonics degree.
pub const MAX_SH_DEGREE: u32 = 3;

/// Opacities below this are never drawn.
const MIN_OPACITY: f32 = 1.0 / 255.0;

/// Lower bound of the mean squared neighbour distance, in `R^2` (3DGS: 1e-7 in world units).
const MIN_SQUARED_DISTANCE: f64 = 1e-7;

/// Scale of a cloud's only point, in `R`.
const LONE_SCALE: f64 = 0.01;

/// The scene as 3D Gaussians; all arrays have one entry a Gaussian, as stored by 3DGS. In the
/// canonical frame ([`Frame`]) unless said otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Centres.
    pub means: Vec<Vec3>,
    /// Natural logarithm of the standard deviations along the principal axes.
    pub scales_log: Vec<Vec3>,
    /// Unnormalised quaternions, w first.
    pub rotations_wxyz: Vec<[f32; 4]>,
    /// `ln(opacity / (1 - opacity))`.
    pub opacity_logits: Vec<f32>,
    /// Spherical-harmonics coefficients `[i][k][c]`: `n * (sh_degree + 1)^2 * 3`.
    pub sh: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub sh_degree: u32,
}

impl Gaussians {
    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Returns whether there is no Gaussian.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Returns whether any view can show a Gaussian at all: it has a rotation, and its values are
    /// finite. Excepted are a scale of nothing, with which it is flat as those of 2DGS are, and an
    /// opacity of 1.
    fn is_whole(&self, i: usize) -> bool {
        let n_sh = 3 * self.n_sh();
        self.means[i].is_finite()
            && self.scales_log[i]
                .to_array()
                .iter()
                .all(|s| *s < f32::INFINITY)
            && self.rotation(i).is_some()
            && !self.opacity_logits[i].is_nan()
            && self.sh[i * n_sh..][..n_sh].iter().all(|c| c.is_finite())
    }

    /// Returns the same without the highest degrees in which no Gaussian has a coefficient.
    pub fn without_empty_degrees(self) -> Gaussians {
        let whole = 3 * self.n_sh();
        let is_empty = |from: usize| {
            let mut own = self.sh.chunks_exact(whole);
            own.all(|sh| sh[from..].iter().all(|c| *c == 0.0))
        };
        let degree = (0..self.sh_degree).find(|degree| is_empty(3 * n_sh(*degree)));
        let Some(sh_degree) = degree else {
            return self;
        };
        Gaussians {
            sh: self.sh_up_to(sh_degree),
            sh_degree,
            ..self
        }
    }

    /// Returns a copy with the colours of degree 0 alone.
    pub fn base(&self) -> Gaussians {
        Gaussians {
            means: self.means.clone(),
            scales_log: self.scales_log.clone(),
            rotations_wxyz: self.rotations_wxyz.clone(),
            opacity_logits: self.opacity_logits.clone(),
            sh: self.sh_up_to(0),
            sh_degree: 0,
        }
    }

    /// Returns the coefficients of the degrees up to `sh_degree`.
    fn sh_up_to(&self, sh_degree: u32) -> Vec<f32> {
        let own = self.sh.chunks_exact(3 * self.n_sh());
        own.flat_map(|sh| &sh[..3 * n_sh(sh_degree)])
            .copied()
            .collect()
    }

    /// Returns the number of Gaussians that no view can show, whatever their opacity.
    pub fn n_broken(&self) -> usize {
        (0..self.len()).filter(|i| !self.is_whole(*i)).count()
    }

    /// Returns the opacity in [0, 1].
    pub fn opacity(&self, i: usize) -> f32 {
        1.0 / (1.0 + (-self.opacity_logits[i]).exp())
    }

    /// Returns the colour of degree 0, RGB, unclamped.
    pub fn base_color(&self, i: usize) -> Vec3 {
        let at = i * self.n_sh() * 3;
        Vec3::splat(0.5) + SH_0 as f32 * Vec3::from_slice(&self.sh[at..at + 3])
    }

    /// Returns the unit rotation, w first and not negative; `None` if it cannot be normalised.
    pub fn rotation(&self, i: usize) -> Option<[f32; 4]> {
        let wxyz = self.rotations_wxyz[i];
        let length = wxyz.iter().map(|q| q * q).sum::<f32>().sqrt();
        let unit = if wxyz[0] < 0.0 { -1.0 } else { 1.0 } / length;
        (length.is_finite() && length > 1e-12).then(|| wxyz.map(|q| q * unit))
    }

    /// Returns the `limit` Gaussians of most weight among those that are ever drawn, heaviest first
    /// and equal ones in order. Weight is opacity times the area of the largest section: about what
    /// a Gaussian covers in an image.
    pub fn heaviest(&self, limit: usize) -> Vec<usize> {
        let is_drawn = |i: &usize| self.is_whole(*i) && self.opacity(*i) >= MIN_OPACITY;
        let weight = |i: usize| {
            let mut s = self.scales_log[i].to_array();
            s.sort_unstable_by(f32::total_cmp);
            self.opacity(i).ln() + s[1] + s[2]
        };
        let mut chosen: Vec<usize> = (0..self.len()).filter(is_drawn).collect();
        chosen.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)));
        chosen.truncate(limit);
        chosen
    }

    /// Returns the number of coefficients a channel, `(sh_degree + 1)^2`.
    pub fn n_sh(&self) -> usize {
        n_sh(self.sh_degree)
    }

    /// Makes the Gaussians that training starts from: one a cloud point, isotropic, as large as the
    /// root mean square distance to the three nearest other points (3DGS), unrotated, of the
    /// cloud's colour from everywhere, and of `config.initial_opacity`.
    ///
    /// Scales are bounded below as in 3DGS, for points that coincide.
    ///
    /// # Errors
    /// An empty cloud; a position or config value that has no finite stored form.
    pub fn from_cloud(cloud: &PointCloud, frame: &Frame, config: &ModelConfig) -> Result<Self> {
        if cloud.is_empty() {
            return Err(
                Error::new("the cloud has no point to start a Gaussian from")
                    .way_out("check the scene's point cloud file"),
            );
        }
        if u32::try_from(cloud.len()).is_err() {
            return Err(Error::new(format!("the cloud has {} points", cloud.len()))
                .way_out(format!("thin it to at most {}", u32::MAX)));
        }
        if config.sh_degree > MAX_SH_DEGREE {
            return Err(Error::usage(format!(
                "model.sh_degree is {}, but at most {MAX_SH_DEGREE} is possible",
                config.sh_degree
            )));
        }
        let opacity_logits = vec![initial_opacity_logit(config)?; cloud.len()];
        let means: Vec<Vec3> = cloud
            .positions
            .iter()
            .map(|p| frame.to_canonical(*p).as_vec3())
            .collect();
        if let Some(i) = means.iter().position(|m| !m.is_finite()) {
            return Err(Error::new(format!(
                "cloud point {i} at {} is out of reach of the sphere around {} of radius {}",
                cloud.positions[i], frame.center, frame.radius
            ))
            .way_out("check that cloud and poses share one frame"));
        }
        let scales = initial_scales(&means);
        let n_sh = n_sh(config.sh_degree);
        let mut sh = vec![0.0; means.len() * n_sh * 3];
        for (sh, rgb) in sh.chunks_exact_mut(n_sh * 3).zip(&cloud.colors) {
            for (dc, value) in sh.iter_mut().zip(rgb) {
                *dc = ((f64::from(*value) / 255.0 - 0.5) / SH_0) as f32;
            }
        }
        Ok(Gaussians {
            scales_log: scales.iter().map(|s| Vec3::splat(s.ln() as f32)).collect(),
            rotations_wxyz: vec![[1.0, 0.0, 0.0, 0.0]; means.len()],
            opacity_logits,
            sh,
            sh_degree: config.sh_degree,
            means,
        })
    }

    /// Appends Gaussians of the same SH degree and frame.
    pub fn extend(&mut self, others: Gaussians) {
        self.means.extend(others.means);
        self.scales_log.extend(others.scales_log);
        self.rotations_wxyz.extend(others.rotations_wxyz);
        self.opacity_logits.extend(others.opacity_logits);
        self.sh.extend(others.sh);
    }

    /// Takes Gaussians from the frame that they are in to `frame`'s canonical one. Rotations
    /// and SH are the same in both.
    pub fn to_canonical(mut self, frame: &Frame) -> Gaussians {
        let scale_log = frame.radius.ln();
        self.means
            .iter_mut()
            .for_each(|m| *m = frame.to_canonical(m.as_dvec3()).as_vec3());
        self.scales_log
            .iter_mut()
            .for_each(|s| *s = (s.as_dvec3() - DVec3::splat(scale_log)).as_vec3());
        self
    }
}

/// Returns the number of spherical-harmonics coefficients a channel up to a degree.
pub fn n_sh(sh_degree: u32) -> usize {
    (sh_degree as usize + 1).pow(2)
}

/// Returns `ln(o / (1 - o))` of the opacity that Gaussians start with.
fn initial_opacity_logit(config: &ModelConfig) -> Result<f32> {
    let logit = (config.initial_opacity / (1.0 - config.initial_opacity)).ln() as f32;
    if !logit.is_finite() {
        return Err(Error::usage(format!(
            "model.initial_opacity is {}, but must lie between 0 and 1",
            config.initial_opacity
        )));
    }
    Ok(logit)
}

/// Returns the root mean square distance to the three nearest other points, bounded below; one a
/// mean.
fn initial_scales(means: &[Vec3]) -> Vec<f64> {
    mean_over_nearest(means, 3, |squared| squared)
        .into_iter()
        .map(|d| {
            d.map_or(LONE_SCALE, f64::sqrt)
                .max(MIN_SQUARED_DISTANCE.sqrt())
        })
        .collect()
}

/// Returns the mean of what `of` makes of the squared distances of every point to its `k` nearest
/// others (fewer where there are not so many), or `None` for a point alone.
///
/// Points that coincide are one entry with a count in the tree: a search among many at one
/// place would visit them all.
pub fn mean_over_nearest(points: &[Vec3], k: usize, of: fn(f64) -> f64) -> Vec<Option<f64>> {
    // Adding 0 makes -0 the same as 0.
    let key = |i: &u32| points[*i as usize].to_array().map(|v| (v + 0.0).to_bits());
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.par_sort_unstable_by_key(|i| (key(i), *i));
    let places: Vec<&[u32]> = order.chunk_by(|a, b| key(a) == key(b)).collect();
    let position = |place: &[u32]| points[place[0] as usize].as_dvec3().to_array();
    let tree = RTree::bulk_load(
        places
            .iter()
            .map(|place| GeomWithData::new(position(place), place.len()))
            .collect(),
    );
    let means: Vec<Option<f64>> = places
        .par_iter()
        .map(|place| {
            // The place itself comes first, at distance 0 and without the point that asks.
            let mut n = 0;
            let mut sum = 0.0;
            for (other, squared) in tree.nearest_neighbor_iter_with_distance_2(position(place)) {
                let count = other.data - usize::from(squared == 0.0);
                let taken = count.min(k - n);
                sum += taken as f64 * of(squared);
                n += taken;
                if n == k {
                    break;
                }
            }
            (n > 0).then(|| sum / n as f64)
        })
        .collect();
    let mut distances = vec![None; points.len()];
    for (place, mean) in places.iter().zip(means) {
        for i in *place {
            distances[*i as usize] = mean;
        }
    }
    distances
}
