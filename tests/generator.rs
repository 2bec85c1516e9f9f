//! The network that makes the Gaussians: its gradient, its start, its bits, and trainings with it.

use gspotential::config::Config;
use gspotential::doctor::twin::random::Random;
use gspotential::pipeline::{Prepared, prepare};
use gspotential::run::Seconds;
use gspotential::scene::builtin::{BuiltinOptions, scene};
use gspotential::train::generator::{Generator, OUTPUTS, Real};
use gspotential::train::{Trainer, generator_bytes};
use nalgebra::DMatrix;

use crate::gpu::rig::context;
use crate::kit::keep::{Keep, same};

/// Places of which the last lies beyond the planes.
fn places(n: usize) -> DMatrix<f64> {
    let mut random = Random::new(7);
    let mut places = DMatrix::from_fn(3, n, |_, _| 0.5 * random.normal());
    places[(1, n - 1)] = -1.7;
    places
}

/// A network none of whose layers is 0, as some are at first.
fn network<T: Real>(n: usize) -> Generator<T> {
    let mut network = Generator::<T>::new(&places(n), 2, 3);
    let mut random = Random::new(8);
    for p in &mut network.parameters {
        *p += nalgebra::convert(0.03 * random.normal());
    }
    network
}

/// Weights of a loss that is linear in what is made.
fn weights<T: Real>(n: usize) -> DMatrix<T> {
    let mut random = Random::new(9);
    DMatrix::from_fn(OUTPUTS, n, |_, _| nalgebra::convert(random.normal()))
}

/// Central differences of a loss along random directions, one of each of many pieces of the parameters.
struct Slopes(Vec<(usize, Vec<f64>, f64)>);

impl Slopes {
    fn new(network: &mut Generator<f64>, weights: &DMatrix<f64>) -> Slopes {
        const PIECE: usize = 9973;
        const STEP: f64 = 1e-6;
        let n = network.parameters.len();
        let mut random = Random::new(10);
        let mut slope = |first: usize| {
            let piece = first..(first + PIECE).min(n);
            let direction: Vec<f64> = piece.clone().map(|_| random.normal()).collect();
            let mut loss = |by: f64| {
                let before = network.parameters[piece.clone()].to_vec();
                let own = network.parameters[piece.clone()].iter_mut();
                own.zip(&direction).for_each(|(p, d)| *p += by * d);
                let loss = network.forward().component_mul(weights).sum();
                network.parameters[piece.clone()].copy_from_slice(&before);
                loss
            };
            let slope = (loss(STEP) - loss(-STEP)) / (2.0 * STEP);
            (first, direction, slope)
        };
        Slopes((0..n).step_by(PIECE).map(&mut slope).collect())
    }

    /// The greatest difference to a gradient, as a share of these slopes.
    fn worst(&self, gradient: &[f64]) -> f64 {
        let off = self.0.iter().map(|(first, direction, slope)| {
            let own = gradient[*first..].iter().zip(direction);
            let ours: f64 = own.map(|(g, d)| g * d).sum();
            (ours - slope).abs() / slope.abs().max(1e-3)
        });
        off.fold(0.0, f64::max)
    }
}

#[test]
fn the_whole_gradient_is_that_of_central_differences() {
    let n = 9;
    let weights = weights(n);
    let mut network = network::<f64>(n);
    let slopes = Slopes::new(&mut network, &weights);
    network.forward();
    let gradient = network.backward(&weights);
    let right = slopes.worst(&gradient);
    assert!(right < 1e-5, "{right}");
    // A thousandth too much in a few layers, wherever they are, is found; and what a row of the outputs leaves out.
    for first in (0..gradient.len() - 20_000).step_by(20_000) {
        let mut planted = gradient.clone();
        let own = planted[first..][..20_000].iter_mut();
        own.for_each(|g| *g *= 1.001);
        let found = slopes.worst(&planted);
        assert!(found > 1e-4, "{first}: {found}");
    }
    for row in 0..OUTPUTS {
        let mut less = weights.clone();
        less.row_mut(row).fill(0.0);
        network.forward();
        let found = slopes.worst(&network.backward(&less));
        assert!(found > 1e-4, "{row}: {found}");
    }
}

#[test]
fn gaussians_start_where_they_are_and_as_large_and_alike_at_one_place() {
    let mut places = places(9);
    let twin = places.column(2).into_owned();
    places.set_column(5, &twin);
    let mut network = Generator::<f64>::new(&places, 2, 3);
    let made = network.forward();
    assert_eq!(made.rows(0, 3).into_owned(), places);
    assert!(made.rows(4, 3).iter().all(|s| *s == 0.0));
    assert_eq!(made.column(2), made.column(5));
    assert!(made.column(2) != made.column(3));
    assert!(made.rows(11, 3).iter().all(|c| (0.0..=1.0).contains(c)));
    // Another seed draws another network.
    assert!(Generator::<f64>::new(&places, 2, 4).forward() != made);
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    // More points and pixels than one product has.
    let n = 1300;
    let made = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            let mut network = Generator::<f32>::new(&places(n), 4, 3);
            let mut made = network.forward();
            for number in 1..4 {
                let gradient = network.backward(&weights(n));
                network.step(&gradient, (number, 1e-3), ([0.9, 0.999], 1e-15));
                made = network.forward();
            }
            made
        })
    };
    let one = made(1);
    assert!(one == made(3));
    assert!(one.iter().all(|x| x.is_finite()));
}

fn config(iterations: u32) -> Config {
    let mut config = Config::preset("splatfields").expect("a preset");
    config.iterations = iterations;
    config.scene.max_points = Some(700);
    config.generator.noise_side = 3;
    config
}

fn prepared(config: &Config) -> Prepared {
    let scene = scene(&BuiltinOptions {
        width: 48,
        n_test: 1,
        ..BuiltinOptions::default()
    });
    prepare(&scene, config, &mut Seconds::default()).expect("prepares")
}

#[test]
fn a_resumed_training_is_bit_for_bit_the_one_that_was_not_interrupted() {
    let config = config(24);
    let prepared = prepared(&config);
    let (start, supervision) = (&prepared.start, &prepared.supervision);
    let ctx = context();
    let trainer =
        || Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits");
    let whole = trainer().run(&mut ()).expect("trains");
    assert_eq!(whole.gaussians.len(), start.len());
    let mut keep = Keep::at(10);
    trainer().run(&mut keep).expect("trains");
    let (state, buffers) = keep.kept.expect("kept");
    let buffers = buffers.concat();
    assert!(state.generator > 100_000);
    let resumed = |buffers: &[u8]| {
        let mut trainer = trainer();
        trainer.restore(state.clone(), buffers).expect("fits");
        trainer.run(&mut ()).expect("trains")
    };
    assert!(same(&resumed(&buffers), &whole));
    // Each third of what the network has in there counts: parameters and both moments.
    for third in 0..3 {
        let mut altered = buffers.clone();
        let first = altered.len() - 4 * state.generator * (3 - third);
        for number in altered[first..][..4 * state.generator].chunks_exact_mut(4) {
            let value = f32::from_le_bytes([number[0], number[1], number[2], number[3]]);
            number.copy_from_slice(&(1.5 * value).to_le_bytes());
        }
        assert!(resumed(&altered).gaussians != whole.gaussians, "{third}");
    }
    let short = &buffers[..buffers.len() - 4];
    assert!(trainer().restore(state.clone(), short).is_err());
    let mut other = state.clone();
    other.generator = 0;
    let error = trainer().restore(other, &buffers).unwrap_err().to_string();
    assert!(error.contains("do not fit"), "{error}");
}

/// Far from the focus, the mean distance has a weight; it draws all Gaussians inwards.
#[test]
fn the_norm_draws_gaussians_to_the_focus() {
    let distance = |weight: f64| {
        let mut config = config(40);
        config.generator.norm_weight = weight;
        config.generator.lr_end = config.generator.lr_start;
        let prepared = prepared(&config);
        let (start, supervision) = (&prepared.start, &prepared.supervision);
        let ctx = context();
        let mut trainer =
            Trainer::new(&ctx.gpu, &ctx.kernels, start, supervision, &config).expect("fits");
        let trained = trainer.run(&mut ()).expect("trains").gaussians;
        let sum: f32 = trained.means.iter().map(|mean| mean.length()).sum();
        sum / trained.len() as f32
    };
    let (free, drawn) = (distance(0.0), distance(10.0));
    assert!(drawn < 0.9 * free, "{drawn} {free}");
}

#[test]
fn memory_grows_with_points_and_noise_and_is_none_without() {
    let bytes = Generator::<f32>::bytes;
    assert!(bytes(2000, 4) > bytes(1000, 4) && bytes(1000, 8) > bytes(1000, 4));
    assert!(bytes(1000, 20) > 100 << 20, "{}", bytes(1000, 20));
    let with = |enabled: bool| {
        let mut config = config(1);
        config.generator.enabled = enabled;
        generator_bytes(1000, &config)
    };
    assert_eq!(with(true), bytes(1000, 3));
    assert_eq!(with(false), 0);
}
