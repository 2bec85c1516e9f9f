//! What each preset changes of another.

use gspotential::config::{Config, Difference};

#[test]
fn baseline_preset_differs_from_the_paper_only_in_views_and_coverage_rules() {
    let mut baseline = Config::preset("3dgs").unwrap();
    assert_eq!(baseline.views.count, 0);
    assert!(!baseline.coverage.prune && !baseline.coverage.densify);
    baseline.preset = "paper".into();
    baseline.views.count = 256;
    baseline.coverage.prune = true;
    baseline.coverage.densify = true;
    assert_eq!(baseline, Config::preset("paper").unwrap());
}

/// What preset `of` has other than `over`.
fn told(of: &str, over: &str) -> Vec<String> {
    let [of, over] = [of, over].map(|name| Config::preset(name).unwrap());
    let differences = of.differences(&over).unwrap();
    differences.iter().map(Difference::setting).collect()
}

#[test]
fn own_preset_differs_from_the_paper_in_its_parts_alone() {
    let expected = [
        "carve.enabled=true",
        "coverage.densify=false",
        "coverage.prune=false",
        "densify.enabled=false",
        "iterations=700",
        "loss.fill_weight=0.3",
        "loss.virtual_photographs=4",
        "model.sh_degree=1",
        "model.sh_interval=150",
        "need.ends=true",
        "need.hold_out=8",
        "need.iterations_a_photograph=175",
        "need.prune=true",
        "need.settle_share=0.2",
        "optimizer.mean_lr_end=0.00064",
        "optimizer.mean_lr_start=0.00064",
        "optimizer.rotation_lr=0.01",
        "optimizer.scale_lr=0.05",
        "optimizer.sh_lr=0.01",
        "scene.pixels_a_point=4.0",
        "shell.count=500",
        "splat.colors=\"blend\"",
        "splat.outline=true",
        "views.visibility.enabled=true",
        "views.visibility.mask_angle_deg=80.0",
        "views.visibility.min_share=0.1",
        "views.visibility.power=0.0",
        "views.within_deg=10.0",
    ];
    assert_eq!(told("gspotential", "paper"), expected);
}

#[test]
fn the_fast_preset_is_the_default_one_with_less_to_do() {
    let expected = [
        "iterations=400",
        "model.sh_degree=0",
        "need.ends=false",
        "need.hold_out=0",
        "need.prune=false",
        "views.count=64",
    ];
    assert_eq!(told("fast", "gspotential"), expected);
}

/// Settings as published, but for the scale of the loss.
#[test]
fn presets_of_other_systems_differ_from_the_baseline_in_what_their_sources_say() {
    let told = |name| told(name, "3dgs");
    assert_eq!(
        told("instantsplat"),
        [
            "densify.enabled=false",
            "iterations=1000",
            "optimizer.confidence_gain=99.0",
            "optimizer.mean_lr_end=0.00013723",
            "optimizer.rotation_lr=0.01",
            "optimizer.scale_lr=0.05",
            "optimizer.sh_lr=0.025",
            "poses.refine=true",
            "poses.shift_lr=0.0001",
            "poses.turn_lr=0.0002",
        ]
    );
    let slow = [
        "densify.end=10000",
        "densify.gradient_threshold=0.0004166666666666667",
        "densify.max_scale=1000000000.0",
        "densify.opacity_reset_end=10000",
    ];
    let ssim = ["loss.ssim_weight=0.16666666666666666"];
    let uniform = ["dropout.rate_end=0.2"];
    assert_eq!(told("dropgaussian"), [&slow[..], &uniform, &ssim].concat());
    let guided = [
        "dropout.density_weight=0.85",
        "dropout.depth_weight=0.15",
        "dropout.rate_end=0.5",
        "dropout.rate_start=0.05",
    ];
    let far = ["loss.far_weight=0.8333333333333334"];
    assert_eq!(told("d2gs"), [&slow[..], &guided, &far, &ssim].concat());
    assert_eq!(
        told("gaussianobject"),
        [
            "densify.max_gaussians=3000000",
            "densify.opacity_reset_interval=1000",
            "densify.outlier_interval=500",
            "loss.random_background=true",
            "loss.silhouette_weight=0.01",
            "model.background=[1.0,1.0,1.0]",
            "model.sh_degree=2",
            "model.start=\"hull\"",
            "optimizer.mean_lr_end=0.00003447",
        ]
    );
    assert_eq!(
        told("splatfields"),
        [
            "densify.enabled=false",
            "generator.enabled=true",
            "iterations=40000",
            "loss.silhouette_weight=0.1",
            "model.sh_degree=0",
        ]
    );
    assert_eq!(
        told("sparsesurf"),
        [
            "densify.end=7000",
            "densify.opacity_reset_end=7000",
            "densify.opacity_reset_interval=1000",
            "iterations=7000",
            "loss.flat_weight=100.0",
            "optimizer.mean_lr_end=0.00005464",
            "prior.loss=\"l1\"",
            "prior.normal_weight=0.05",
            "prior.source=\"cloud\"",
        ]
    );
    assert_eq!(
        told("corgs"),
        [
            "densify.end=15000",
            "densify.gradient_threshold=0.0005",
            "densify.max_scale=1000000000.0",
            "densify.opacity_reset_end=15000",
            "iterations=30000",
            "loss.random_background=true",
            "model.sh_interval=500",
            "partner.enabled=true",
        ]
    );
    assert_eq!(
        told("fsgs"),
        [
            "densify.end=10000",
            "densify.gradient_threshold=0.0005",
            "densify.max_scale=1000000000.0",
            "densify.opacity_reset_end=10000",
            "model.sh_interval=500",
            "prior.end=9500",
            "prior.end_weight=0.001",
            "prior.source=\"cloud\"",
            "unpool.until=2000",
        ]
    );
    assert_eq!(
        told("sparsegs"),
        [
            "densify.end=18000",
            "densify.min_opacity=0.05",
            "densify.opacity_reset_end=18000",
            "floaters.after=20000",
            "iterations=30000",
            "prior.patch_weight=0.15",
            "prior.source=\"cloud\"",
        ]
    );
}

/// Table 2 of the paper: what each row has that the row under it in the list lacks.
#[test]
fn ablation_presets_add_one_part_each_to_another() {
    let changed = |name: &str, from: &str| -> Vec<String> {
        let [config, from] = [name, from].map(|name| Config::preset(name).unwrap());
        let differences = config.differences(&from).unwrap();
        differences.iter().map(Difference::setting).collect()
    };
    let (prune, densify) = ("coverage.prune=true", "coverage.densify=true");
    for (name, from, expected) in [
        (
            "ablation-virtual",
            "3dgs",
            &[
                "field.lambda=0.0",
                "loss.confidence_weighting=false",
                "views.count=256",
                "views.strategy=\"interpolation\"",
            ][..],
        ),
        (
            "ablation-info",
            "ablation-virtual",
            &["views.strategy=\"potential\""],
        ),
        ("ablation-prune", "ablation-info", &[prune]),
        ("ablation-densify", "ablation-info", &[densify]),
        ("ablation-both", "ablation-info", &[densify, prune]),
        (
            "paper",
            "ablation-both",
            &["field.lambda=0.2", "loss.confidence_weighting=true"],
        ),
    ] {
        let mut changed = changed(name, from);
        changed.sort();
        assert_eq!(changed, expected, "{name} from {from}");
    }
    // A config file may start from one, as the config.json of such a run does.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("config.json");
    let config = Config::preset("ablation-info").unwrap();
    std::fs::write(&path, config.to_json().unwrap()).unwrap();
    assert_eq!(Config::from_file(&path).unwrap(), config);
}
