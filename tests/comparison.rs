//! Several runs in one table, as JSON and as CSV.

use gspotential::config::Config;
use gspotential::metrics::lpips::{InputRange, Net};
use gspotential::metrics::{CoveredScore, LpipsRecord, MaskedScore, Renders, ViewScore};
use gspotential::report::{ComparedRun, Comparison, runs_csv, runs_json};
use gspotential::run::{Evaluation, Measured, Memory, Metrics, RunDir, SceneRecord, Seconds};
use gspotential::scene::PoseProtocol;
use serde_json::Value;

/// A run that is made without training.
#[derive(Clone)]
struct Made {
    name: &'static str,
    scene: &'static str,
    settings: &'static [&'static str],
    preset: &'static str,
    psnr: f64,
    lpips: Option<(Net, InputRange)>,
    train_views: &'static [&'static str],
    image_px: [u32; 2],
    pose_protocol: PoseProtocol,
    renders: Renders,
    train_s: f64,
    masked: bool,
    cloud: Option<&'static str>,
}

const PAPER: Made = Made {
    name: "a",
    scene: "garden",
    settings: &[],
    preset: "paper",
    psnr: 20.0,
    lpips: None,
    train_views: &["x", "y"],
    image_px: [320, 213],
    pose_protocol: PoseProtocol::SharedFrame,
    renders: Renders::Rounded,
    train_s: 100.0,
    masked: false,
    cloud: None,
};

const BASELINE: Made = Made {
    name: "b",
    preset: "3dgs",
    psnr: 18.0,
    train_s: 50.0,
    ..PAPER
};

impl Made {
    fn run(&self) -> ComparedRun {
        let folder = tempfile::tempdir().unwrap();
        let mut config = Config::preset(self.preset).unwrap();
        for setting in self.settings {
            config = config.set(setting).unwrap();
        }
        let run = RunDir::create(&folder.path().join(self.name), &config, false).unwrap();
        run.write_metrics(&self.metrics(&config)).unwrap();
        ComparedRun::new(&run, self.evaluation()).unwrap()
    }

    fn metrics(&self, config: &Config) -> Metrics {
        Metrics {
            version: "1.2.3".into(),
            commit: None,
            adapter: "none".into(),
            rasterizer: None,
            seed: config.seed,
            iterations: config.iterations,
            scene: SceneRecord {
                source: format!("/scenes/{}", self.scene),
                cloud: self.cloud.map(str::to_owned),
                name: self.scene.into(),
                train_views: self.train_views.iter().map(|&v| v.into()).collect(),
                test_views: vec!["t".into(), "u".into()],
                n_test_trained: 0,
                n_points: 3,
                cloud_crc32: None,
                thumbnails: None,
                virtual_images: None,
                carved_points: None,
                pose_protocol: self.pose_protocol,
            },
            seconds: Seconds {
                load: Some(1.0),
                train: Some(self.train_s),
                eval: Some(7.0),
                ..Seconds::default()
            },
            memory: Memory::default(),
            loss: Vec::new(),
            model_size: Vec::new(),
            refined_poses: Vec::new(),
            curve: Vec::new(),
            signal: Vec::new(),
            trims: Vec::new(),
            lowering: None,
            energy_j: None,
            chosen: Vec::new(),
        }
    }

    fn evaluation(&self) -> Evaluation {
        let view = |name: &str, psnr: f64| ViewScore {
            name: name.into(),
            psnr: Some(psnr),
            ssim: Some(psnr / 40.0),
            lpips: self.lpips.map(|_| psnr / 100.0),
            fitted_psnr: self.masked.then_some(psnr + 3.0),
            masked: self.masked.then_some(MaskedScore {
                psnr: Some(psnr + 5.0),
                ssim: Some(0.9),
                lpips: None,
                coverage: 0.25,
            }),
            covered: self.masked.then_some(CoveredScore {
                psnr: Some(psnr + 2.0),
                coverage: 0.75,
            }),
        };
        let views = vec![view("t", self.psnr - 1.0), view("u", self.psnr + 1.0)];
        let mut evaluation = Evaluation::new(views, 1000, Some(self.train_s));
        evaluation.measured = Some(Measured {
            version: "1.2.3".into(),
            point_cloud_sha256: "00".into(),
            point_cloud_bytes: 2_500_000,
            config_sha256: "11".into(),
            scene_stamp: None,
            image_px: Some(self.image_px),
            pose_protocol: self.pose_protocol,
            renders: self.renders,
            lpips: self.lpips.map(|(net, range)| LpipsRecord {
                net,
                range,
                weights_sha256: "0123456789abcdef".into(),
            }),
        });
        evaluation
    }
}

fn table(runs: &[Made]) -> String {
    let runs: Vec<ComparedRun> = runs.iter().map(Made::run).collect();
    Comparison::new(&runs).unwrap().to_string()
}

/// The table's rows below its header, cell by cell.
fn rows(text: &str) -> Vec<Vec<String>> {
    let lines = text.lines().filter(|line| line.starts_with('|')).skip(2);
    lines
        .map(|line| {
            let cells = line.trim_matches('|').split('|');
            cells.map(|cell| cell.trim().to_owned()).collect()
        })
        .collect()
}

#[test]
fn methods_of_a_scene_stand_together_with_the_best_in_bold() {
    let text = table(&[PAPER, BASELINE]);
    assert_eq!(
        rows(&text),
        [
            [
                "garden (320x213, 2 test views)",
                "paper",
                "**20.00**",
                "**0.500**",
                "n/a",
                "101.0",
                "1000",
                "2.5"
            ],
            [
                "", "3dgs", "18.00", "0.450", "n/a", "**51.0**", "1000", "2.5"
            ],
        ]
    );
    for part in [
        "PSNR dB ↑ |",
        "LPIPS ↓ |",
        "time s ↓ |",
        "All runs: 10000 iterations, at most as many points as training pixels, 2 training views.",
        "rounded to 8 bit",
        "in one frame with the training cameras",
        "LPIPS is n/a: --lpips-weights FILE",
        "lpips.LPIPS(net='vgg')",
    ] {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
    // What is equal as printed is equally good.
    let close = Made {
        psnr: 19.998,
        ..BASELINE
    };
    let cells = rows(&table(&[PAPER, close]));
    assert_eq!((&*cells[0][2], &*cells[1][2]), ("**20.00**", "**20.00**"));
    // One row is not the best of anything.
    let alone = Made {
        scene: "desk",
        ..BASELINE
    };
    assert!(!table(&[PAPER, alone]).contains("**"));
}

#[test]
fn seeds_are_averaged_with_their_standard_deviation() {
    let seed = |name, settings, psnr| Made {
        name,
        settings,
        psnr,
        ..PAPER
    };
    let runs = [
        seed("s0", &["seed=0"], 20.0),
        seed("s1", &["seed=1"], 21.0),
        seed("s2", &["seed=2"], 22.0),
    ];
    let text = table(&runs);
    let cells = rows(&text);
    assert_eq!(cells.len(), 1, "{text}");
    assert_eq!(cells[0][2], "21.00 ± 1.00");
    assert_eq!(cells[0].last().unwrap(), "3");
    assert!(text.contains("± standard deviation"), "{text}");
    // An identical image in one of them has an infinite PSNR, and no spread.
    let mut perfect = runs.clone();
    perfect[1].psnr = f64::INFINITY;
    assert_eq!(rows(&table(&perfect))[0][2], "inf");
}

#[test]
fn runs_of_one_seed_are_not_averaged() {
    let again = Made {
        name: "again",
        psnr: 20.5,
        ..PAPER
    };
    let cells = rows(&table(&[PAPER, again]));
    assert_eq!(
        (&*cells[0][1], &*cells[1][1]),
        ("paper [a]", "paper [again]")
    );
    assert_eq!(cells.len(), 2);
}

#[test]
fn other_settings_are_other_rows_that_say_so() {
    let with = |settings| Made { settings, ..PAPER };
    let label = |made: Made| rows(&table(&[PAPER, made]))[1][1].clone();
    assert_eq!(
        label(with(&["loss.ssim_weight=0.3", "views.count=8", "seed=4"])),
        "paper (loss.ssim_weight=0.3, views.count=8)"
    );
    assert_eq!(label(with(&["iterations=500"])), "paper, 500 iterations");
    assert_eq!(
        label(with(&["scene.max_points=90"])),
        "paper, at most 90 points"
    );
    let other_views = Made {
        train_views: &["x", "z"],
        settings: &["seed=1"],
        ..PAPER
    };
    assert_eq!(label(other_views), "paper, trained on x z");
    let more_views = Made {
        train_views: &["x", "y", "z", "v", "w"],
        ..PAPER
    };
    assert_eq!(label(more_views), "paper, 5 training views");
    // All of them say it, also those that did not change it.
    let text = table(&[PAPER, with(&["iterations=500"])]);
    assert_eq!(rows(&text)[0][1], "paper, 10000 iterations");
    assert!(text.contains("All runs: at most"), "{text}");
}

#[test]
fn another_cloud_is_another_row_that_names_it() {
    let noisy = Made {
        name: "noisy",
        cloud: Some("/scenes/garden/sparse/0/points3D_noisy.ply"),
        settings: &["seed=1"],
        ..PAPER
    };
    let text = table(&[PAPER, noisy]);
    assert_eq!(rows(&text).len(), 2, "{text}");
    assert!(text.contains("paper (cloud=points3D_noisy.ply)"), "{text}");
}

#[test]
fn other_image_sizes_and_test_views_are_other_blocks() {
    let large = Made {
        image_px: [640, 426],
        psnr: 30.0,
        ..BASELINE
    };
    let text = table(&[PAPER, large]);
    let scenes: Vec<_> = rows(&text).into_iter().map(|row| row[0].clone()).collect();
    assert_eq!(
        scenes,
        [
            "garden (320x213, 2 test views)",
            "garden (640x426, 2 test views)"
        ]
    );
    assert!(
        !text.contains("**") && text.contains("No mean over scenes"),
        "{text}"
    );
}

#[test]
fn means_over_scenes_are_of_methods_that_have_all() {
    let desk = |made: Made, psnr| Made {
        scene: "desk",
        psnr,
        ..made
    };
    let other = Made {
        settings: &["views.count=8"],
        ..PAPER
    };
    let text = table(&[
        PAPER,
        BASELINE,
        other,
        desk(PAPER, 30.0),
        desk(BASELINE, 31.0),
    ]);
    let cells = rows(&text);
    assert_eq!(cells.len(), 7, "{text}");
    assert_eq!(cells[5][..3], ["mean of 2 scenes", "paper", "**25.00**"]);
    assert_eq!(cells[6][..3], ["", "3dgs", "24.50"]);
    assert!(
        text.contains("of the methods that are in all of them"),
        "{text}"
    );
}

#[test]
fn lpips_of_different_nets_and_ranges_stand_apart() {
    let with = |made: Made, net, range| Made {
        lpips: Some((net, range)),
        ..made
    };
    let vgg = with(PAPER, Net::Vgg, InputRange::Unit);
    let text = table(&[vgg.clone(), with(BASELINE, Net::Alex, InputRange::Signed)]);
    assert!(
        text.contains("| lpips(vgg,[0,1]) ↓ | lpips(alex,[-1,1]) ↓ |"),
        "{text}"
    );
    let cells = rows(&text);
    assert_eq!(cells[0][4..6], ["0.200", "n/a"]);
    assert_eq!(cells[1][4..6], ["n/a", "0.180"]);
    assert!(!text.contains("--lpips-weights"), "{text}");
    // A column with a gap says how to fill it.
    let text = table(&[vgg.clone(), BASELINE]);
    assert_eq!(rows(&text)[1][4], "n/a");
    assert!(text.contains("--lpips-weights"), "{text}");
    // Lower is better.
    let text = table(&[vgg, with(BASELINE, Net::Vgg, InputRange::Unit)]);
    assert_eq!(rows(&text)[1][4], "**0.180**");
    assert!(!text.contains("n/a"), "{text}");
}

#[test]
fn fitted_masked_and_covered_figures_have_columns_of_their_own() {
    let text = table(&[
        Made {
            masked: true,
            ..PAPER
        },
        BASELINE,
    ]);
    let cells = rows(&text);
    assert_eq!(cells[0][5..10], ["23.00", "25.00", "0.900", "n/a", "22.00"]);
    assert_eq!(cells[1][5..10], ["n/a"; 5]);
    assert!(text.contains("best 3x4 colour matrix"), "{text}");
    assert!(text.contains("the same pixels for every run"), "{text}");
    assert!(text.contains("Masked: PSNR of the mask's pixels"), "{text}");
}

#[test]
fn what_does_not_compare_is_refused() {
    let refused = |other: Made| {
        let runs = [PAPER.run(), other.run()];
        Comparison::new(&runs).unwrap_err().to_string()
    };
    let error = refused(Made {
        pose_protocol: PoseProtocol::TestPoseFit,
        ..BASELINE
    });
    for part in [
        "`a`",
        "`b`",
        "fitted to the test photographs",
        "a table of their own",
    ] {
        assert!(error.contains(part), "no `{part}` in: {error}");
    }
    let error = refused(Made {
        renders: Renders::Float,
        ..BASELINE
    });
    assert!(error.contains("in the same way"), "{error}");
    assert!(Comparison::new(&[]).is_err());
}

#[test]
fn an_evaluation_of_an_older_version_does_not_say_enough() {
    let folder = tempfile::tempdir().unwrap();
    let config = Config::preset("paper").unwrap();
    let run = RunDir::create(&folder.path().join("old"), &config, false).unwrap();
    run.write_metrics(&PAPER.metrics(&config)).unwrap();
    let mut evaluation = PAPER.evaluation();
    evaluation.measured = None;
    let error = ComparedRun::new(&run, evaluation).unwrap_err().to_string();
    assert!(
        error.contains("old") && error.contains("gspotential eval"),
        "{error}"
    );
}

#[test]
fn json_and_csv_hold_every_field_of_every_run() {
    let vgg = Made {
        lpips: Some((Net::Vgg, InputRange::Signed)),
        settings: &["loss.ssim_weight=0.3", "iterations=500", "seed=4"],
        masked: true,
        ..PAPER
    };
    let odd = Made {
        scene: "a, \"b\"",
        psnr: f64::INFINITY,
        ..BASELINE
    };
    let runs = [vgg.run(), odd.run()];
    let tree: Value = serde_json::from_slice(&runs_json(&runs).unwrap()).unwrap();
    let first = &tree["runs"][0];
    for (key, value) in [
        ("psnr_db", serde_json::json!(20.0)),
        ("lpips", serde_json::json!(0.2)),
        ("lpips_net", "vgg".into()),
        ("lpips_range", "-1,1".into()),
        ("renders", "8-bit".into()),
        ("pose_protocol", "shared_frame".into()),
        ("method", "paper (loss.ssim_weight=0.3)".into()),
        ("changes", "iterations=500; loss.ssim_weight=0.3".into()),
        ("seed", 4.into()),
        ("fitted_psnr_db", serde_json::json!(23.0)),
        ("masked_psnr_db", serde_json::json!(25.0)),
        ("n_masked_views", 2.into()),
        ("covered_psnr_db", serde_json::json!(22.0)),
        ("coverage", serde_json::json!(0.75)),
        ("time_s", serde_json::json!(101.0)),
        ("eval_s", serde_json::json!(7.0)),
        ("point_cloud_bytes", 2_500_000.into()),
        ("image_width_px", 320.into()),
        ("train_views", serde_json::json!(["x", "y"])),
    ] {
        assert_eq!(first[key], value, "{key}");
    }
    assert_eq!(first["views"][1]["psnr_db"], 21.0);
    assert!(tree["runs"][1]["psnr_db"].is_null() && tree["runs"][1]["lpips"].is_null());

    let bytes = runs_csv(&runs).unwrap();
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let header = reader.headers().unwrap().clone();
    let lines: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(lines.len(), 2);
    let cell = |line: usize, key: &str| {
        let column = header.iter().position(|name| name == key).expect(key);
        lines[line][column].to_owned()
    };
    assert_eq!(cell(0, "psnr_db"), "20.0");
    assert_eq!(cell(0, "lpips_range"), "-1,1");
    assert_eq!(cell(1, "scene"), "a, \"b\"");
    assert_eq!(
        (cell(1, "psnr_db"), cell(1, "lpips")),
        ("inf".into(), String::new())
    );
    // The same fields in both, but for the lists.
    let object = first.as_object().unwrap();
    assert!(header.iter().all(|key| object.contains_key(key)));
    assert_eq!(object.len(), header.len() + 2);
}
