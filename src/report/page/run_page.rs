//! This module writes one run's page.

use maud::{Markup, PreEscaped, html};
use rayon::prelude::*;

use super::curves::{self, Trained};
use super::data::{CameraKind, PageData};
use super::packed::{MAX_PACKED, PACKED_BYTES, pack};
use super::picture::{MAX_ERROR, Picture, base64, error_map, picture, side_of};
use super::{document, json, table};
use crate::camera::Frame;
use crate::camera::json::read_cameras;
use crate::config::Config;
use crate::error::Result;
use crate::files::write_file;
use crate::gaussians::ply::read_ply;
use crate::metrics::ViewScore;
use crate::report::table::figure;
use crate::report::{read_png, view_table};
use crate::run::{Evaluation, Metrics, RunDir, file_names};
use crate::scene::View;

/// Longer side of the contact sheet of virtual views, pixels.
const SHEET_SIDE: u32 = 1200;

const SCRIPTS: [&str; 4] = [
    include_str!("common.js"),
    include_str!("compare.js"),
    include_str!("globe.js"),
    include_str!("viewer.js"),
];

const SHADERS: [(&str, &str); 2] = [
    ("vertex-shader", include_str!("viewer.vert")),
    ("fragment-shader", include_str!("viewer.frag")),
];

/// A test view as the page shows it.
struct PageView<'a> {
    score: &'a ViewScore,
    render: Picture,
    truth: Picture,
    error: Picture,
}

/// Writes `report.html` from what is in the run directory; `test` are its scene's test views and
/// `frame` its canonical frame.
///
/// # Errors
/// A file of the run that is missing or cannot be read.
pub fn write_run_page(run: &RunDir, test: &[View], frame: &Frame) -> Result<()> {
    let (config, metrics, evaluation) = (run.config()?, run.metrics()?, run.evaluation()?);
    let cameras = read_cameras(&run.cameras())?;
    let data = PageData::new(&cameras, frame, &config, Some(&metrics.scene))?;
    let stored = read_ply(&run.point_cloud())?;
    let n_gaussians = stored.gaussians.len();
    let packed = pack(&stored.to_canonical(frame), MAX_PACKED);
    let side = test
        .first()
        .map_or(0, |view| side_of(test.len(), &view.image));
    let views = page_views(run, (test, side), &evaluation)?;
    let sheet = match data.n_cameras(CameraKind::Virtual) {
        0 => None,
        _ => Some(picture(&read_png(&run.virtual_sheet())?, SHEET_SIDE)?),
    };
    let plots = curves::plots(&[Trained::of(&run.name(), &metrics, config.loss.ssim_weight)])?;
    let body = html! {
        (head(&run.name(), &config, &metrics, &evaluation))
        (scene_section(Some((packed.len() / PACKED_BYTES, n_gaussians))))
        @if !views.is_empty() { (view_section(&views, side)) }
        (field_section(&data))
        @if let Some(sheet) = &sheet { (virtual_section(sheet, &data)) }
        h2 { "Training" }
        div.plots { @for plot in &plots { div { (PreEscaped(plot)) } } }
        h2 { "Test views" }
        (table(&view_table(&evaluation)))
        (point_splat(&evaluation))
        (details(&config, &metrics)?)
        script #data type="application/json" { (json(&data)?) }
        script #gaussians type="text/plain" { (base64(&packed)) }
        (shaders())
    };
    let page = document(&format!("{} - gspotential", run.name()), body, &SCRIPTS);
    write_file(&run.report(), page.as_bytes())
}

fn page_views<'a>(
    run: &RunDir,
    (test, side): (&[View], u32),
    evaluation: &'a Evaluation,
) -> Result<Vec<PageView<'a>>> {
    let names: Vec<&str> = test.iter().map(|view| view.camera.name.as_str()).collect();
    let files = file_names(&names, "png");
    test.par_iter()
        .zip(&files)
        .zip(&evaluation.views)
        .map(|((view, file), score)| {
            let render = read_png(&run.test_views().join(file))?;
            Ok(PageView {
                score,
                render: picture(&render, side)?,
                truth: picture(&view.image, side)?,
                error: error_map(&render, &view.image, side).map_err(|e| e.at(&score.name))?,
            })
        })
        .collect()
}

fn head(name: &str, config: &Config, metrics: &Metrics, evaluation: &Evaluation) -> Markup {
    let mean = &evaluation.mean;
    let facts = [
        (figure(mean.psnr, 2), "PSNR, dB"),
        (figure(mean.ssim, 4), "SSIM"),
        (figure(mean.lpips, 4), "LPIPS"),
        (evaluation.n_gaussians.to_string(), "Gaussians"),
        (figure(evaluation.train_s, 1), "seconds of training"),
    ];
    let scene = &metrics.scene;
    html! {
        h1 { (name) }
        p.quiet {
            "Scene " (scene.name) " (" (scene.source) "), " (scene.train_views.len())
            " training and " (scene.test_views.len()) " test views, " (scene.n_points)
            " points; preset " (config.preset) ", " (metrics.iterations) " iterations, seed "
            (metrics.seed) "; gspotential " (metrics.version) " on " (metrics.adapter) "."
            @if scene.n_test_trained > 0 {
                " " (scene.n_test_trained) " of the test views were trained on."
            }
        }
        ul.facts { @for (value, what) in &facts { li { strong { (value) } span { (what) } } } }
        @if !metrics.chosen.is_empty() {
            p.quiet { "Chosen for this scene:" }
            ul.quiet { @for sentence in &metrics.chosen { li { (sentence) } } }
        }
    }
}

/// The shaders of the viewer, which its script finds in the page.
pub(super) fn shaders() -> Markup {
    html! {
        @for (id, source) in SHADERS { script id=(id) type="x-shader" { (PreEscaped(source)) } }
    }
}

/// The viewer's part of a page; `shown` is how many Gaussians of how many it holds, where that is
/// known beforehand.
pub(super) fn scene_section(shown: Option<(usize, usize)>) -> Markup {
    html! {
        h2 { "Scene" }
        canvas #scene tabindex="0" aria-label="The trained scene; drag or use the arrow keys to turn it" {}
        div.controls {
            label { input #scene-turn type="checkbox"; " turn" }
            label { "seen from " select #scene-camera {} }
        }
        p #scene-note .quiet {
            "Drag to turn, scroll to go nearer. "
            @if let Some((n_shown, n_gaussians)) = shown && n_shown < n_gaussians {
                (n_shown) " of " (n_gaussians) " Gaussians are shown, those of most weight (opacity "
                "times area; a page holds at most " (MAX_PACKED) "). "
            }
            "Positions have 16 bits, scales, rotations and colours 8; colours are those of "
            "degree 0, the same from everywhere."
        }
    }
}

fn view_section(views: &[PageView], side: u32) -> Markup {
    html! {
        h2 { "Renders beside photographs" }
        p.quiet {
            "Left of the slider the render, right of it the photograph. Beside them the mean "
            "absolute error of the channels, from 0 (dark) to " (MAX_ERROR) " and more (yellow). "
            "Pictures are JPEGs of at most " (side) " pixels."
        }
        div.views { @for view in views { (view_figure(view)) } }
    }
}

fn view_figure(view: &PageView) -> Markup {
    let ViewScore {
        name, psnr, ssim, ..
    } = view.score;
    html! {
        figure {
            div.pair {
                (slider(&view.render, &view.truth, name))
                (image(&view.error, "error"))
            }
            figcaption { (name) ": " (figure(*psnr, 2)) " dB, SSIM " (figure(*ssim, 4)) }
        }
    }
}

/// Lays `left` and `right` on one another, cut by a slider.
fn slider(left: &Picture, right: &Picture, name: &str) -> Markup {
    html! {
        div.compare {
            (image(left, "render"))
            (image(right, "photograph"))
            input type="range" min="0" max="100" value="50" aria-label={ "cut of " (name) };
        }
    }
}

fn image(picture: &Picture, what: &str) -> Markup {
    html! { img src=(picture.uri) width=(picture.width) height=(picture.height) alt=(what); }
}

pub(super) fn field_section(data: &PageData) -> Markup {
    let kinds = [
        (CameraKind::Training, "training"),
        (CameraKind::Test, "test"),
        (CameraKind::Virtual, "virtual"),
    ];
    html! {
        h2 { "Camera potential field" }
        div.controls {
            label { select #field-quantity aria-label="quantity" {} }
            span #field-min {} canvas #field-scale width="256" height="1" {} span #field-max {}
            @for (kind, name) in kinds {
                span { span.mark.(name) {} (name) " (" (data.n_cameras(kind)) ")" }
            }
        }
        div.field {
            canvas #globe width="320" height="320" tabindex="0"
                aria-label="The field on the sphere; drag or use the arrow keys to turn it" {}
            canvas #map width="720" height="360" aria-label="The field as a flat map" {}
        }
        p #field-readout .quiet {}
        p.quiet {
            "Directions as seen from the focus. Map: azimuth from -180 degrees on the left to 180 on "
            "the right, 0 at the first training camera and growing to the right of someone there who "
            "looks at the focus; elevation from 90 at the top to -90."
        }
    }
}

fn virtual_section(sheet: &Picture, data: &PageData) -> Markup {
    html! {
        h2 { "Virtual views" }
        figure.sheet {
            div { (image(sheet, "virtual views and their masks")) }
            figcaption {
                "The point cloud in " (data.n_cameras(CameraKind::Virtual))
                " virtual views in the order of the draw, each beside its mask: white pixels train."
            }
        }
    }
}

fn point_splat(evaluation: &Evaluation) -> Markup {
    html! {
        @if let Some(splat) = &evaluation.point_splat {
            p.quiet {
                "Bare point splat of the cloud: " (figure(splat.psnr, 2)) " dB, SSIM "
                (figure(splat.ssim, 4)) "; " (figure(splat.psnr_covered, 2)) " dB on the "
                (format!("{:.1}", 100.0 * splat.coverage)) " % of the pixels that it covers."
            }
        }
    }
}

fn details(config: &Config, metrics: &Metrics) -> Result<Markup> {
    let seconds = &metrics.seconds;
    let stages = [
        ("load", seconds.load),
        ("field", seconds.field),
        ("carve", seconds.carve),
        ("sample", seconds.sample),
        ("splat", seconds.splat),
        ("train", seconds.train),
        ("evaluate", seconds.eval),
    ];
    let mebibytes = |bytes: Option<u64>| figure(bytes.map(|b| b as f64 / 1048576.0), 0);
    Ok(html! {
        h2 { "Details" }
        p {
            "Seconds: "
            @for (i, (stage, s)) in stages.iter().enumerate() {
                @if i > 0 { ", " } (stage) " " (figure(*s, 2))
            }
            ". Peak memory: " (mebibytes(metrics.memory.host_peak_bytes)) " MiB of the process, "
            (mebibytes(metrics.memory.gpu_peak_bytes)) " MiB of GPU buffers."
        }
        details { summary { "config.json" } pre { (config.to_json()?) } }
    })
}
