//! Presets, overlays and ranges of the config.

use gspotential::config::{Config, Difference, PRESETS, reference};
use gspotential::error::{Error, ErrorKind};
use serde_json::Value;

fn paper() -> Config {
    Config::preset("paper").unwrap()
}

/// Asserts a usage error that mentions all of `parts`.
#[track_caller]
fn assert_refused<T: std::fmt::Debug>(result: Result<T, Error>, parts: &[&str]) {
    let error = result.expect_err("was accepted");
    assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "no `{part}` in: {text}");
    }
    assert!(!text.contains('\n'), "more than one line: {text}");
}

fn file(text: &str) -> Result<Config, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("my.json");
    std::fs::write(&path, text).unwrap();
    Config::from_file(&path)
}

fn leaves(tree: &Value, prefix: &str, out: &mut Vec<String>) {
    match tree {
        Value::Object(section) => section
            .iter()
            .for_each(|(name, value)| leaves(value, &format!("{prefix}/{name}"), out)),
        _ => out.push(prefix.to_owned()),
    }
}

#[test]
fn every_preset_is_valid_and_states_only_what_it_changes() {
    assert_eq!(paper(), Config::default());
    for (name, text) in PRESETS {
        let config = Config::preset(name).unwrap();
        config.validate().unwrap();
        assert_eq!(config.preset, *name);

        let stated: Value = serde_json::from_str(text).unwrap();
        let base = stated["preset"].as_str().unwrap_or("paper");
        let base = serde_json::to_value(Config::preset(base).unwrap()).unwrap();
        let mut keys = Vec::new();
        leaves(&stated, "", &mut keys);
        for key in keys.iter().filter(|key| *key != "/preset") {
            assert_ne!(stated.pointer(key), base.pointer(key), "`{name}`: {key}");
        }
    }
}

#[test]
fn the_reference_page_is_the_declaration() {
    let page = include_str!("../configs/README.md");
    let (_, keys) = page.split_once("## Every key\n").expect("a heading");
    assert!(
        keys.trim() == reference().unwrap().trim(),
        "configs/README.md: replace what follows `## Every key` by what `gspotential presets --keys` prints"
    );
}

#[test]
fn the_reference_tells_values_units_words_ranges_and_the_papers_names() {
    let text = reference().unwrap();
    for line in [
        "- `iterations` = 700, 400 in `fast`, 1000 in `instantsplat`, 40000 in `splatfields`, 7000 in `sparsesurf`, 30000 in `corgs` and `sparsegs`, 10000 in all others.",
        "- `field.lambda` = 0.2, 0.0 in `ablation-virtual` and `ablation-info`",
        "### `views.visibility`",
        "`U_total`. Allowed: a finite number, 0 or more. Paper: lambda, Eq. 4.",
        "Choices: `pixel`, `disc`.",
        "Unit: R. Allowed: 2 to 1000000.",
    ] {
        assert!(text.contains(line), "no `{line}` in: {text}");
    }
}

#[test]
fn settings_change_only_their_own_value() {
    let config = paper().set("loss.ssim_weight=0.3").unwrap();
    assert_eq!(config.loss.ssim_weight, 0.3);
    assert_eq!(config.set("loss.ssim_weight=0.2").unwrap(), paper());

    let config = paper().set("scene.max_points=500").unwrap();
    assert_eq!(config.scene.max_points, Some(500));
    let config = config.set("scene.max_points=null").unwrap();
    assert_eq!(config.scene.max_points, None);

    let config = paper().set("model.background=[1, 0.5, 0]").unwrap();
    assert_eq!(config.model.background, [1.0, 0.5, 0.0]);
    // An integer will do for a real number, a whole section for its values.
    let config = paper().set("field={\"lambda\": 1}").unwrap();
    assert_eq!(config.field.lambda, 1.0);
    assert_eq!(config.field.sigma, paper().field.sigma);
}

#[test]
fn unknown_keys_are_refused_with_the_near_miss() {
    let set = |setting| paper().set(setting);
    assert_refused(
        set("loss.ssim_wieght=0.3"),
        &["`loss.ssim_wieght`", "did you mean `loss.ssim_weight`?"],
    );
    assert_refused(
        set("loss.sigma=1"),
        &["`loss.sigma`", "did you mean `field.sigma`?"],
    );
    assert_refused(set("lss.ssim_weight=1"), &["`lss`", "`loss`"]);
    assert_refused(set("xylophone=1"), &["`xylophone`", "config.json"]);
    assert_refused(set("seed.low=1"), &["`seed`", "u64"]);
    assert_refused(set("loss=3"), &["section", "`loss.ssim_weight`"]);
    assert_refused(set("seed"), &["`seed`", "key=value"]);
    assert_refused(set("preset=3dgs"), &["--preset"]);
    assert_refused(set("=1"), &["no config key"]);
    assert_refused(Config::preset("papr"), &["`papr`", "did you mean `paper`?"]);
    assert_refused(Config::preset("xylophone"), &["`paper`", "`3dgs`"]);
}

#[test]
fn wrong_types_are_named_with_their_key() {
    for (setting, parts) in [
        ("iterations=many", ["`iterations`", "\"many\""]),
        ("iterations=1.5", ["`iterations`", "1.5"]),
        ("iterations=-1", ["`iterations`", "-1"]),
        ("iterations=5000000000", ["`iterations`", "5000000000"]),
        ("coverage.prune=1", ["`coverage.prune`", "boolean"]),
        ("loss.ssim_weight=NaN", ["`loss.ssim_weight`", "\"NaN\""]),
        (
            "loss.ssim_weight=1e999",
            ["`loss.ssim_weight`", "\"1e999\""],
        ),
        ("model.background=[1,1]", ["`model.background`", "length 2"]),
        (
            "field.kernel=sec",
            ["`field.kernel` cannot be \"sec\"", "did you mean `sech`?"],
        ),
        (
            "views.strategy=sphere_furthest",
            ["`views.strategy`", "did you mean `sphere_farthest`?"],
        ),
        (
            "views.strategy=xylophone",
            ["`nearest_angle`", "`interpolation`"],
        ),
        (
            "views.visibility=true",
            ["section", "`views.visibility.enabled`"],
        ),
    ] {
        assert_refused(paper().set(setting), &parts);
    }
}

#[test]
fn config_files_overlay_the_preset_that_they_name() {
    let config = file(r#"{"preset": "3dgs", "iterations": 7, "loss": {"ssim_weight": 0.5}}"#);
    let mut expected = Config::preset("3dgs").unwrap();
    expected.iterations = 7;
    expected.loss.ssim_weight = 0.5;
    assert_eq!(config.unwrap(), expected);
    let default = Config::preset("gspotential").unwrap();
    assert_eq!(file("{}").unwrap(), default);
}

#[test]
fn faulty_config_files_are_named_with_line_or_key() {
    assert_refused(file("{\n\"seed\": }"), &["my.json", "line 2 column"]);
    assert_refused(file("[1]"), &["my.json", "object"]);
    assert_refused(file(r#"{"preset": 3}"#), &["my.json", "`preset`"]);
    assert_refused(file(r#"{"preset": "no"}"#), &["my.json", "`no`"]);
    assert_refused(
        file(r#"{"views": {"cuont": 3}}"#),
        &["my.json", "`views.cuont`", "did you mean `views.count`?"],
    );
    assert_refused(file(r#"{"views.count": 3}"#), &["my.json", "nest"]);
    let deep = format!("{}1{}", "[".repeat(100_000), "]".repeat(100_000));
    assert_refused(file(&deep), &["recursion"]);
}

#[test]
fn a_generator_goes_with_nothing_that_changes_the_set() {
    let generator = Config::preset("splatfields").unwrap();
    generator.validate().unwrap();
    for (setting, key) in [
        ("densify.enabled=true", "`densify.enabled`"),
        ("coverage.prune=true", "`coverage.prune`"),
        ("partner.enabled=true", "`partner.enabled`"),
        ("model.sh_degree=1", "`model.sh_degree`"),
        ("shell.count=100", "`shell.count`"),
        ("loss.flat_weight=1", "`loss.flat_weight`"),
        ("optimizer.confidence_gain=1", "`optimizer.confidence_gain`"),
        ("dropout.depth_weight=0.1", "`dropout.depth_weight`"),
        ("dropout.density_weight=0.1", "`dropout.density_weight`"),
    ] {
        let config = generator.set(setting).unwrap();
        assert_refused(config.validate(), &[key, "with generator.enabled"]);
        let without = config.set("generator.enabled=false").unwrap();
        without.validate().unwrap();
    }
    for setting in ["need.prune=true", "need.max_mb=1"] {
        let config = generator.set("need.hold_out=2").unwrap();
        let config = config.set(setting).unwrap();
        assert_refused(config.validate(), &["`need.", "with generator.enabled"]);
    }
    let rising = generator.set("generator.lr_end=0.1").unwrap();
    assert_refused(rising.validate(), &["`generator.lr_end`"]);
}

#[test]
fn a_partner_goes_with_none_of_what_it_has_no_place_for() {
    let partner = Config::preset("corgs").unwrap();
    for (setting, key) in [
        ("views.count=1", "`views.count`"),
        ("poses.refine=true", "`poses.refine`"),
        ("dropout.depth_weight=0.1", "`dropout.depth_weight`"),
        ("dropout.density_weight=0.1", "`dropout.density_weight`"),
        ("densify.outlier_interval=500", "`densify.outlier_interval`"),
        ("unpool.until=2000", "`unpool.until`"),
        ("floaters.after=9", "`floaters.after`"),
        (
            "optimizer.confidence_gain=99",
            "`optimizer.confidence_gain`",
        ),
        ("prior.source=cloud", "`prior.source`"),
    ] {
        let config = partner.set(setting).unwrap();
        assert_refused(config.validate(), &[key, "with partner.enabled"]);
        let single = config.set("partner.enabled=false").unwrap();
        single.validate().unwrap();
    }
    partner
        .set("dropout.rate_end=0.5")
        .unwrap()
        .validate()
        .unwrap();
}

#[test]
fn resolved_config_reads_back_as_it_was() {
    let config = Config::preset("3dgs")
        .unwrap()
        .set("field.lambda=0.1")
        .unwrap()
        .set("seed=18446744073709551615")
        .unwrap();
    assert_eq!(file(&config.to_json().unwrap()).unwrap(), config);
}

#[test]
fn values_out_of_range_are_refused_with_key_and_value() {
    for setting in [
        "iterations=0",
        "scene.max_width_px=0",
        "scene.max_size_px=0",
        "scene.n_train=0",
        "scene.max_points=0",
        "carve.threshold=-0.1",
        "carve.window_px=4",
        "carve.depth_tolerance=0",
        "carve.max_rounds=0",
        "carve.max_share=1",
        "field.sigma=0",
        "field.lambda=-0.1",
        "field.n_candidates=0",
        "views.count=4097",
        "views.epsilon=0",
        "views.visibility.max_angle_deg=0",
        "views.visibility.max_angle_deg=181",
        "views.visibility.power=-1",
        "views.visibility.min_share=1.1",
        "views.visibility.depth_tolerance=1",
        "splat.max_radius_px=0.7",
        "splat.depth_tolerance=-0.1",
        "splat.filter_window_px=4",
        "splat.filter_window_px=4294967295",
        "splat.filter_min_neighbors=25",
        "model.sh_degree=4",
        "model.sh_interval=0",
        "model.initial_opacity=1",
        "scene.pixels_a_point=0",
        "model.near=0",
        "model.background=[0, 0, 1.5]",
        "loss.ssim_weight=1.01",
        "loss.virtual_weight=-1",
        "loss.fill_weight=1.1",
        "shell.count=99",
        "shell.radius=1",
        "prior.png_step=0",
        "prior.weight=-1",
        "prior.patch_weight=-1",
        "prior.patch_px=7",
        "prior.patch_px=1025",
        "prior.normal_weight=-1",
        "prior.end=0",
        "dropout.rate_start=1",
        "dropout.rate_end=1",
        "dropout.depth_weight=1.1",
        "dropout.density_weight=-0.1",
        "partner.weight=-1",
        "partner.prune_interval=0",
        "partner.prune_distance=0",
        "poses.turn_lr=-1",
        "poses.shift_lr=1",
        "poses.rate_left=0",
        "optimizer.mean_lr_start=0",
        "optimizer.mean_lr_end=1",
        "optimizer.sh_lr=-1",
        "optimizer.opacity_lr=-1",
        "optimizer.scale_lr=-1",
        "optimizer.rotation_lr=-1",
        "optimizer.beta1=1",
        "optimizer.beta2=-0.5",
        "optimizer.epsilon=0",
        "densify.start=6001",
        "densify.interval=0",
        "densify.gradient_threshold=0",
        "densify.split_scale=0",
        "densify.min_opacity=0.1",
        "densify.max_scale=0",
        "densify.max_screen=0",
        "densify.opacity_reset_interval=0",
        "densify.max_gaussians=0",
        "coverage.interval=0",
        "coverage.tau_min=0.5",
        "coverage.tau_min=101",
        "coverage.tau_max=19",
        "coverage.delta_min=9e-4",
        "coverage.delta_max=0",
        "coverage.anisotropy_epsilon=0",
        "coverage.max_pruned_share=1.1",
    ] {
        let config = paper().set(setting).unwrap();
        let key = setting.split('=').next().unwrap();
        // If two values are in the wrong order, the lower one's key is named.
        let named = if key == "coverage.tau_max" {
            "coverage.tau_min"
        } else {
            key
        };
        assert_refused(config.validate(), &[&format!("`{named}` is "), "allowed: "]);
    }
}

#[test]
fn interpolation_has_no_candidates_to_weigh_by_visibility() {
    let interpolation = paper().set("views.strategy=interpolation").unwrap();
    interpolation.validate().unwrap();
    let weighed = interpolation.set("views.visibility.enabled=true").unwrap();
    assert_refused(
        weighed.validate(),
        &["`views.visibility.enabled` is true", "interpolation"],
    );
}

#[test]
fn values_that_are_no_number_are_refused() {
    let edits: [fn(&mut Config) -> &mut f64; 8] = [
        |c| &mut c.field.sigma,
        |c| &mut c.field.lambda,
        |c| &mut c.loss.ssim_weight,
        |c| &mut c.carve.threshold,
        |c| &mut c.views.visibility.max_angle_deg,
        |c| &mut c.coverage.tau_max,
        |c| &mut c.optimizer.beta1,
        |c| &mut c.densify.min_opacity,
    ];
    for edit in edits {
        for value in [f64::NAN, f64::INFINITY] {
            let mut config = paper();
            *edit(&mut config) = value;
            assert_refused(config.validate(), &["allowed"]);
        }
    }
}

#[test]
fn changes_are_the_values_that_differ_from_the_preset() {
    for (preset, _) in PRESETS {
        let config = Config::preset(preset).unwrap();
        assert!(config.changes().unwrap().is_empty());
        assert!(config.set("seed=9").unwrap().changes().unwrap().is_empty());
        for left in ["render.rasterizer=thread", "render.exp2=polynomial"] {
            let run = config.set(left).unwrap();
            assert!(run.changes().unwrap().is_empty(), "the adapter's: {left}");
        }
    }
    let mut config = Config::preset("paper").unwrap();
    for setting in ["views.count=8", "iterations=500", "scene.max_points=90"] {
        config = config.set(setting).unwrap();
    }
    let changes = config.changes().unwrap();
    let shown: Vec<String> = changes.iter().map(Difference::setting).collect();
    assert_eq!(
        shown,
        ["iterations=500", "scene.max_points=90", "views.count=8"]
    );
}

#[test]
fn a_run_departs_from_what_was_asked_but_not_from_what_was_left_to_its_adapter() {
    let asked = paper();
    for (key, decided, other) in [
        ("render.rasterizer", "workgroup", "thread"),
        ("render.exp2", "adapter", "polynomial"),
    ] {
        let run = asked.set(&format!("{key}={decided}")).unwrap();
        assert!(run.departures(&asked).unwrap().is_empty());
        let stated = asked.set(&format!("{key}={other}")).unwrap();
        let departures = run.departures(&stated).unwrap();
        let keys: Vec<&str> = departures.iter().map(|d| d.key.as_str()).collect();
        assert_eq!(keys, [key]);
        let other = run.set("iterations=7").unwrap();
        assert_eq!(other.departures(&asked).unwrap().len(), 1);
    }
}
