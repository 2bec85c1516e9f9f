//! This module makes the page of a training as it runs, or of a finished model: the same viewer,
//! field and curves as in `report.html`, fed by a server instead of by the page itself.

use maud::{DOCTYPE, Markup, html};

use super::curves::{self, Trained};
use super::data::PageData;
use super::json;
use super::packed::{MAX_PACKED, pack};
use super::picture::{jpeg, side_of};
use super::run_page::{field_section, scene_section, shaders};
use crate::camera::{Camera, Frame};
use crate::config::Config;
use crate::error::Result;
use crate::gaussians::Gaussians;
use crate::run::{CurvePoint, ModelSize, SceneRecord};
use crate::scene::{Image, View};
use crate::train::{LossSample, SignalPoint};

/// The page's own files, with their media types.
const ASSETS: [(&str, &str, &str); 5] = [
    ("style.css", "text/css", super::STYLE),
    ("common.js", SCRIPT, include_str!("common.js")),
    ("globe.js", SCRIPT, include_str!("globe.js")),
    ("viewer.js", SCRIPT, include_str!("viewer.js")),
    ("live.js", SCRIPT, include_str!("live.js")),
];

const SCRIPT: &str = "text/javascript";

/// Returns media type and text of the page's file `name`; `None` if it has none of that name.
pub fn live_asset(name: &str) -> Option<(&'static str, &'static str)> {
    let found = ASSETS.iter().find(|(asset, ..)| *asset == name)?;
    Some((found.1, found.2))
}

/// Packs Gaussians in the canonical frame as the page's viewer reads them: those of most weight, where
/// there are more than a page holds.
pub fn live_gaussians(gaussians: &Gaussians) -> Vec<u8> {
    pack(gaussians, MAX_PACKED)
}

/// Returns the photograph of one of `n_views` views as a JPEG of the size that the page shows it at.
///
/// # Errors
/// A picture that cannot be encoded.
pub fn live_photograph(image: &Image, n_views: usize) -> Result<Vec<u8>> {
    jpeg(image, side_of(n_views, image))
}

/// A course is what has been noted of a training so far.
#[derive(Clone, Debug, Default)]
pub struct Course {
    /// Weight of the SSIM term in the loss.
    pub ssim_weight: f64,
    /// Losses on the way.
    pub loss: Vec<LossSample>,
    /// Numbers of Gaussians on the way.
    pub model_size: Vec<ModelSize>,
    /// Errors at the test views on the way.
    pub curve: Vec<CurvePoint>,
    /// What the held-out views said on the way.
    pub signal: Vec<SignalPoint>,
}

impl Course {
    /// Draws the curves as SVG; none before the first loss is known.
    ///
    /// # Errors
    /// A plot that cannot be drawn.
    pub fn plots(&self) -> Result<Vec<String>> {
        let Some(last) = self.loss.last() else {
            return Ok(Vec::new());
        };
        curves::plots(&[Trained {
            name: "",
            ssim_weight: self.ssim_weight,
            iterations: last.iteration,
            loss: &self.loss,
            model_size: &self.model_size,
            curve: &self.curve,
            signal: &self.signal,
        }])
    }
}

/// This is all that a page says of its scene; what changes with time comes later.
pub struct LivePage<'a> {
    /// Heading: the run's or the file's name.
    pub name: &'a str,
    /// Cameras in the world; one at least.
    pub cameras: &'a [Camera],
    /// The canonical frame.
    pub frame: &'a Frame,
    /// The resolved config.
    pub config: &'a Config,
    /// The scene that was trained on; `None` of a file that belongs to no run.
    pub scene: Option<&'a SceneRecord>,
    /// The views whose photographs are at hand: `photograph-I` is that of number I.
    pub views: &'a [&'a View],
}

impl LivePage<'_> {
    /// Returns the page.
    ///
    /// # Errors
    /// There is no camera.
    pub fn html(&self) -> Result<String> {
        let data = PageData::new(self.cameras, self.frame, self.config, self.scene)?;
        Ok(document(
            self.name,
            html! {
                @if let Some(scene) = self.scene {
                    p.quiet {
                        "Scene " (scene.name) " (" (scene.source) "), " (scene.train_views.len())
                        " training and " (scene.test_views.len()) " test views; preset "
                        (self.config.preset) ", seed " (self.config.seed) "."
                    }
                }
                (progress())
                (scene_section(None))
                p #live-shown .quiet {}
                @if !self.views.is_empty() { (view_section(self.views, &data)) }
                h2 { "Training" }
                div #live-curves .plots {}
                @if data.has_field() { (field_section(&data)) }
                script #data type="application/json" { (json(&data)?) }
                (shaders())
            },
        ))
    }

    /// Returns the page that is shown as long as there is nothing to see.
    pub fn waiting() -> String {
        document("gspotential", progress())
    }
}

fn document(name: &str, body: Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (name) " - gspotential" }
                link rel="stylesheet" href="style.css";
            }
            body {
                main { h1 { (name) } (body) }
                @for (script, kind, _) in ASSETS {
                    @if kind == SCRIPT { script src=(script) {} }
                }
            }
        }
    }
    .into_string()
}

/// How far it is; the script fills it in.
fn progress() -> Markup {
    let facts = [
        ("done", "iterations"),
        ("left", "left"),
        ("loss", "loss"),
        ("held-out", "PSNR of held-out views, dB"),
        ("test", "PSNR of test views, dB"),
        ("gaussians", "Gaussians"),
    ];
    html! {
        p #live-phase {}
        progress #live-progress hidden {}
        ul.facts {
            @for (id, what) in facts { li { strong #{ "live-" (id) } { "-" } span { (what) } } }
        }
    }
}

fn view_section(views: &[&View], data: &PageData) -> Markup {
    html! {
        h2 { "Views beside photographs" }
        p.quiet { "Left the scene as it is now, drawn by this page; right the photograph." }
        div.views {
            @for (i, view) in views.iter().enumerate() {
                @let name = &view.camera.name;
                @if let Some(camera) = data.cameras.iter().position(|c| c.name == *name) {
                    (view_figure(view, (i, views.len()), camera))
                }
            }
        }
    }
}

fn view_figure(view: &View, (i, n): (usize, usize), camera: usize) -> Markup {
    let View {
        camera: own, image, ..
    } = view;
    let side = f64::from(side_of(n, image));
    let scale = (side / f64::from(image.width.max(image.height))).min(1.0);
    let pixels = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    let (width, height) = (pixels(image.width), pixels(image.height));
    html! {
        figure data-camera=(camera) {
            div.pair {
                canvas width=(width) height=(height) aria-label={ "the scene from " (own.name) } {}
                img src={ "photograph-" (i) } loading="lazy" width=(width) height=(height)
                    alt={ "photograph " (own.name) };
            }
            figcaption { (own.name) }
        }
    }
}
