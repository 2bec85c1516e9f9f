//! The generator makes the Gaussians (Mihajlovic et al. 2024, "SplatFields"): a network of their places, whose parameters are
//! trained in place of theirs. Its features vary slowly, so that neighbours get like attributes.
//!
//! Three convolutional decoders make planes of fixed noise, each that of a latent diffusion model's autoencoder (Rombach et al. 2022),
//! narrow and without attention. A Gaussian's features are what the planes show at the place that it starts from
//! (`seen`); perceptrons make of place and features where it goes, and there its opacity, scales, rotation and
//! colour. The network runs on the CPU.

mod generated;
mod layers;
mod parameters;
mod seen;

use std::ops::Range;

use nalgebra::DMatrix;

pub(in crate::train) use self::generated::Generated;
pub use self::generated::generator_bytes;
use self::layers::{
    Layer, backward, convolution, forward, n_held, normalization, perceptron, residual, stacked,
};
pub use self::parameters::Real;
use self::parameters::{Draws, real};
use self::seen::{CHANNELS, FEATURES, Lookup, encoded, encoded_backward};

/// Rows of what is made of a Gaussian: centre, opacity's logit, what is added to the logarithms of the scales, quaternion, colour.
pub const OUTPUTS: usize = 14;
const CENTER: Range<usize> = 0..3;
/// In [0, 1].
const COLOR: Range<usize> = 11..14;

/// Channels of the noise.
const NOISE: usize = 8;
/// Channels of the images that become a plane.
const WIDTH: usize = 32;
/// Times that an image's side is doubled.
const DOUBLINGS: u32 = 3;

/// A perceptron that sees waves of a place, so many, and its features.
struct Head {
    layers: Vec<Layer>,
    waves: usize,
    /// What it makes.
    rows: Range<usize>,
}

/// What layers have made, and what each of them started from.
type Made<T> = (DMatrix<T>, Vec<DMatrix<T>>);

/// What everything has made.
struct Whole<T> {
    decoded: Vec<Made<T>>,
    refined: Made<T>,
    headed: Vec<Made<T>>,
    outputs: DMatrix<T>,
}

/// The network with the places that it makes Gaussians of.
pub struct Generator<T> {
    /// All parameters.
    pub parameters: Vec<T>,
    /// Adam's running means of their gradient and of its square.
    pub moments: [Vec<T>; 2],
    noise: [DMatrix<T>; 3],
    decoders: [Vec<Layer>; 3],
    /// What all heads see of the features.
    refine: Vec<Layer>,
    /// The first makes the centre, the others what depends on it.
    heads: Vec<Head>,
    places: DMatrix<T>,
    lookup: Lookup<T>,
    /// What the last [`Generator::forward`] has made.
    whole: Option<Whole<T>>,
}

impl<T: Real> Generator<T> {
    /// Draws a network for Gaussians that start at `places`, a column each: planes span -1 to 1. The noise has
    /// `noise_side` x `noise_side` pixels, a plane eight times as many a side.
    pub fn new(places: &DMatrix<f64>, noise_side: usize, seed: u64) -> Generator<T> {
        let mut draws = Draws::new(seed);
        let noise = [(); 3].map(|()| {
            let drawn = draws.normal(NOISE, noise_side * noise_side, 1.0);
            draws.withdraw(drawn)
        });
        let decoders = [(); 3].map(|()| decoder(&mut draws));
        let refine = perceptron(&mut draws, &[FEATURES; 3], None, false);
        let heads = heads(&mut draws);
        let parameters: Vec<T> = draws.into_values();
        Generator {
            moments: [(); 2].map(|()| vec![T::zero(); parameters.len()]),
            parameters,
            noise,
            decoders,
            refine,
            heads,
            places: places.map(real),
            lookup: Lookup::new(places, noise_side << DOUBLINGS),
            whole: None,
        }
    }

    /// Makes the Gaussians, [`OUTPUTS`] rows.
    pub fn forward(&mut self) -> DMatrix<T> {
        let parameters = &self.parameters;
        let decoders = self.decoders.iter().zip(&self.noise);
        let decoded = decoders.map(|(layers, noise)| forward(layers, parameters, noise.clone()));
        let decoded: Vec<Made<T>> = decoded.collect();
        let features = self.lookup.features(decoded.iter().map(|(plane, _)| plane));
        let refined = forward(&self.refine, parameters, features);
        let mut outputs = DMatrix::zeros(OUTPUTS, self.places.ncols());
        outputs.rows_range_mut(CENTER).copy_from(&self.places);
        let mut headed = Vec::new();
        for head in &self.heads {
            // The first sees the place that a Gaussian starts from, the others the one where it goes.
            let waves = encoded(&outputs.rows_range(CENTER).into_owned(), head.waves);
            let made = forward(&head.layers, parameters, stacked(&waves, &refined.0));
            let mut own = outputs.rows_range_mut(head.rows.clone());
            own += &made.0;
            headed.push(made);
        }
        let mut colors = outputs.rows_range_mut(COLOR);
        colors.apply(|x| *x = T::one() / (T::one() + (-*x).exp()));
        self.whole = Some(Whole {
            decoded,
            refined,
            headed,
            outputs: outputs.clone(),
        });
        outputs
    }

    /// Returns the parameters' gradient from that of what the last [`Generator::forward`] has made; 0 before.
    pub fn backward(&mut self, d_outputs: &DMatrix<T>) -> Vec<T> {
        let mut gradient = vec![T::zero(); self.parameters.len()];
        let Some(whole) = self.whole.take() else {
            return gradient;
        };
        let parameters = &self.parameters;
        let mut d = d_outputs.clone();
        let colors = whole.outputs.rows_range(COLOR);
        let mut d_colors = d.rows_range_mut(COLOR);
        d_colors.zip_apply(&colors, |d, y| *d *= y * (T::one() - y));
        let mut d_features = DMatrix::zeros(FEATURES, d.ncols());
        // The first head comes last: the centre's gradient is whole by then.
        for (head, (_, starts)) in self.heads.iter().zip(&whole.headed).rev() {
            let own = d.rows_range(head.rows.clone()).into_owned();
            let d_input = backward(&head.layers, parameters, starts, own, &mut gradient);
            d_features += d_input.rows(3 + 6 * head.waves, FEATURES);
            // What the first layer with weights started from.
            let Some(input) = starts.iter().find(|start| !start.is_empty()) else {
                continue;
            };
            let mut d_centers = d.rows_range_mut(CENTER);
            d_centers += encoded_backward(input, &d_input, head.waves);
        }
        let d_features = backward(
            &self.refine,
            parameters,
            &whole.refined.1,
            d_features,
            &mut gradient,
        );
        for (k, (layers, (plane, starts))) in self.decoders.iter().zip(&whole.decoded).enumerate() {
            let d_plane = self.lookup.backward(k, plane.ncols(), &d_features);
            backward(layers, parameters, starts, d_plane, &mut gradient);
        }
        gradient
    }

    /// Takes step `number`, from 1, of Adam (Kingma and Ba 2015; bias-corrected, epsilon added to the root, as PyTorch).
    pub fn step(
        &mut self,
        gradient: &[T],
        (number, rate): (u32, f64),
        (betas, epsilon): ([f64; 2], f64),
    ) {
        let corrections = betas.map(|beta| 1.0 - beta.powf(f64::from(number)));
        let [rate, spread] = [rate / corrections[0], 1.0 / corrections[1].sqrt()].map(real::<T>);
        let (kept, fresh) = (betas.map(real::<T>), betas.map(|b| real::<T>(1.0 - b)));
        let epsilon = real::<T>(epsilon);
        let [first, second] = &mut self.moments;
        let moments = first.iter_mut().zip(second);
        for ((p, g), (m, v)) in self.parameters.iter_mut().zip(gradient).zip(moments) {
            *m = kept[0] * *m + fresh[0] * *g;
            *v = kept[1] * *v + fresh[1] * *g * *g;
            *p -= rate * *m / (v.sqrt() * spread + epsilon);
        }
    }

    /// Returns about how many bytes the network and what it holds for the way back take at most.
    pub fn bytes(n_gaussians: usize, noise_side: usize) -> u64 {
        let mut draws = Draws::new(0);
        let decoders = [(); 3].map(|()| decoder(&mut draws));
        let heads = heads(&mut draws);
        let of_planes = decoders
            .iter()
            .map(|layers| n_held(layers, noise_side * noise_side));
        let of_points = heads.iter().map(|head| n_held(&head.layers, n_gaussians));
        // Four vectors as long as that of the parameters; features and outputs, some copies of each.
        let n = of_planes.chain(of_points).sum::<usize>() + 4 * draws.into_values::<T>().len();
        ((n + n_gaussians * (6 * FEATURES + 4 * OUTPUTS)) * size_of::<T>()) as u64
    }
}

/// Draws what makes a plane of noise: two residual steps, and four blocks of two, between which the image is doubled.
fn decoder(draws: &mut Draws) -> Vec<Layer> {
    let mut layers = vec![convolution(draws, NOISE, WIDTH)];
    layers.extend(residual(draws, WIDTH));
    for block in 0..=DOUBLINGS {
        if block > 0 {
            layers.extend([Layer::Double, convolution(draws, WIDTH, WIDTH)]);
        }
        layers.extend(
            residual(draws, WIDTH)
                .into_iter()
                .chain(residual(draws, WIDTH)),
        );
    }
    layers.extend([
        normalization(draws, WIDTH),
        convolution(draws, WIDTH, CHANNELS),
    ]);
    layers
}

/// Draws the heads: of the centre, the opacity, the scales, the rotation and the colour. Centres and scales start as the cloud has them.
fn heads(draws: &mut Draws) -> Vec<Head> {
    let mut head = |waves, (width, n_hidden), skip, rows: Range<usize>, starts_at_zero| {
        let mut widths = vec![3 + 6 * waves + FEATURES];
        widths.extend(vec![width; n_hidden]);
        widths.push(rows.len());
        Head {
            layers: perceptron(draws, &widths, skip, starts_at_zero),
            waves,
            rows,
        }
    };
    vec![
        head(6, (128, 7), Some(3), CENTER, true),
        head(3, (64, 5), Some(2), 3..4, false),
        head(4, (64, 5), Some(2), 4..7, true),
        head(3, (64, 4), None, 7..11, false),
        head(6, (128, 7), Some(3), COLOR, false),
    ]
}
