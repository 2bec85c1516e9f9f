//! The settings of the choices that lie in the kernels, as changes of their sources.

use gspotential::gpu::constants::ALPHA_MIN;

/// A replacement in the complete source of one stage.
pub struct Edit {
    stage: &'static str,
    from: String,
    to: String,
}

/// One setting of one choice; an empty choice is the program as it is.
pub struct Variant {
    pub choice: &'static str,
    pub setting: String,
    edits: Vec<Edit>,
    /// Whether SH coefficients are stored as pairs of half floats.
    pub half_sh: bool,
    /// Bits of the depth keys; the sort's time is counted for as many passes as they need.
    pub depth_bits: u32,
}

pub const ALPHA: &str = "alpha cut-off";
pub const TILES: &str = "tiles of a splat";
pub const DEPTH: &str = "depth keys";
pub const EXP: &str = "2^x";
pub const SH: &str = "SH storage";

impl Variant {
    fn new(choice: &'static str, setting: &str, edits: Vec<Edit>) -> Variant {
        Variant {
            choice,
            setting: setting.to_owned(),
            edits,
            half_sh: false,
            depth_bits: 32,
        }
    }

    /// The source of a stage under this setting.
    ///
    /// # Panics
    /// If what is to be replaced is not there: the shader has changed.
    pub fn apply(&self, stage: &str, mut source: String) -> String {
        for edit in self.edits.iter().filter(|edit| edit.stage == stage) {
            assert!(source.contains(&edit.from), "{stage}: no `{}`", edit.from);
            source = source.replace(&edit.from, &edit.to);
        }
        if self.half_sh && ["project", "project_backward"].contains(&stage) {
            source = halve_sh(&source);
        }
        source
    }
}

fn edit(stage: &'static str, from: &str, to: &str) -> Edit {
    Edit {
        stage,
        from: from.to_owned(),
        to: to.to_owned(),
    }
}

/// What the program uses, by choice.
pub const KEPT: [(&str, &str); 5] = [
    (ALPHA, "1/255"),
    (TILES, "rows of the ellipse"),
    (DEPTH, "32 bits"),
    (EXP, "polynomial of degree 6"),
    (SH, "32-bit floats"),
];

/// The program as it is, and every other setting.
pub fn all() -> Vec<Variant> {
    let mut all = vec![Variant::new("", "", Vec::new())];
    all.extend([65_536, 1024, 512, 128, 64, 32].map(alpha));
    all.extend([bounding_box(), square()]);
    all.extend([16, 24, 28].map(depth));
    all.extend(exponentials());
    all.push(Variant {
        half_sh: true,
        ..Variant::new(SH, "16-bit floats", Vec::new())
    });
    all
}

/// Splats fainter than `1 / inverse` are skipped. The finest stands for none at all.
fn alpha(inverse: u32) -> Variant {
    let constant = |value: f64| format!("const ALPHA_MIN = f32({value:e});");
    let (from, to) = (constant(ALPHA_MIN), constant(1.0 / f64::from(inverse)));
    let mut edits: Vec<Edit> = ["project", "rasterize", "rasterize_backward"]
        .map(|stage| edit(stage, &from, &to))
        .into();
    let reach = format!("log2({inverse}.0 * opacity)");
    edits.push(edit("project", "log2(LEVEL_MAX * opacity)", &reach));
    Variant::new(ALPHA, &format!("1/{inverse}"), edits)
}

/// Every tile that the ellipse's bounding box meets.
fn bounding_box() -> Variant {
    let edits = vec![
        edit("bin", "clamp(o.t_right, min(t_0, t_1), t_1)", "o.t_right"),
        edit("bin", "clamp(-o.t_right, min(t_0, t_1), t_1)", "-o.t_right"),
    ];
    Variant::new(TILES, "its bounding box", edits)
}

/// 3DGS's square of three standard deviations of the longer axis.
fn square() -> Variant {
    let side = "let inv_xx = 1.0 / s1.x;
        let k_yy = CONIC_SCALE * inv_yy;
        let k_xx = CONIC_SCALE * inv_xx;
        let shear = -s1.y * inv_xx;
        let var_yy = k_yy * k_yy;
        let var_xy = shear * var_yy;
        let var_xx = k_xx * k_xx + shear * var_xy;
        let spread = length(vec2f(var_xx - var_yy, 2.0 * var_xy));
        let half_side = ceil(3.0 * sqrt(0.5 * (var_xx + var_yy + spread)));
        let mean_y = -s0.w * inv_yy;";
    let edits = vec![
        edit("bin", "let inv_xx = 1.0 / s1.x;", side),
        edit("bin", "- (s0.w + radius) * inv_yy", "+ mean_y - half_side"),
        edit("bin", "- (s0.w - radius) * inv_yy", "+ mean_y + half_side"),
        edit(
            "bin",
            "o.t_right = radius * slope / sqrt(1.0 + slope * slope);",
            "o.t_right = half_side;",
        ),
        edit(
            "bin",
            "let right = (sqrt(max(o.reach - right_y * right_y, 0.0)) - right_x) * o.inv_xx;",
            "let mean_x = (o.l_xy * o.t_0.y * o.inv_yy - o.t_0.x) * o.inv_xx;
        let right = mean_x + o.t_right;",
        ),
        edit(
            "bin",
            "let left = -(sqrt(max(o.reach - left_y * left_y, 0.0)) + left_x) * o.inv_xx;",
            "let left = mean_x - o.t_right;",
        ),
    ];
    Variant::new(TILES, "3DGS's square of 3 sigma", edits)
}

/// Keys of fewer bits drop the lowest of the 32; those of 31 and 30 drop what f32 tells apart only
/// near the frame's origin.
fn depth(bits: u32) -> Variant {
    let dropped = 32 - bits;
    let edits = vec![edit(
        "project",
        "vec2u(depth_key(o.p), id)",
        &format!("vec2u((depth_key(o.p) >> {dropped}u) << {dropped}u, id)"),
    )];
    Variant {
        depth_bits: bits,
        ..Variant::new(DEPTH, &format!("{bits} bits"), edits)
    }
}

fn exponentials() -> [Variant; 4] {
    let horner = "var p = vec4f(EXP2_C6);
    p = p * f + EXP2_C5;
    p = p * f + EXP2_C4;
    p = p * f + EXP2_C3;
    p = p * f + EXP2_C2;
    p = p * f + EXP2_C1;
    p = p * f + 1.0;";
    let in_both = |setting: &str, from: &str, to: &str| {
        let edits = ["rasterize", "rasterize_backward"].map(|stage| edit(stage, from, to));
        Variant::new(EXP, setting, edits.into())
    };
    let head = "fn exp2_negative(x: vec4f) -> vec4f {";
    let instead = |body: &str| format!("{head} {body} }}\nfn exp2_kept(x: vec4f) -> vec4f {{");
    [
        in_both("the driver's exp2", head, &instead("return exp2(x);")),
        in_both(
            "polynomial of degree 4",
            horner,
            "let p = 1.0 + f * (0.6930448447922098 + f * (0.24128020526334684
                + f * (0.05224247350349111 + f * 0.013426684590121862)));",
        ),
        in_both(
            "polynomial of degree 3",
            horner,
            "let p = 1.0 + f * (0.6951167878464738 + f * (0.22764498773841776
                + f * 0.0770670440000495));",
        ),
        in_both(
            "linear between powers (Schraudolph)",
            head,
            &instead(
                "return bitcast<vec4f>(vec4i(max(x, vec4f(-126.0)) * 8388608.0) + 1064992512);",
            ),
        ),
    ]
}

/// SH planes of four half floats.
fn halve_sh(source: &str) -> String {
    let mut out = source.to_owned();
    for name in ["sh_0", "sh_2", "sh_3"] {
        let declared = format!("{name}: array<vec4f>;");
        assert!(out.contains(&declared), "no `{declared}`");
        out = out.replace(&declared, &format!("{name}: array<vec2u>;"));
        out = wrapped(&out, &format!("{name}["));
    }
    // By integers: not every adapter unpacks half floats. Their exponent is 112 less.
    out + "
fn from_halves(v: vec2u) -> vec4f {
    let h = vec4u(v.x, v.x >> 16u, v.y, v.y >> 16u);
    return bitcast<vec4f>(((h & vec4u(0x7fffu)) << vec4u(13u)) | ((h & vec4u(0x8000u)) << vec4u(16u))) * 5.192296858534828e33;
}
"
}

/// `source` with every `open...]` as an argument of `from_halves`.
fn wrapped(source: &str, open: &str) -> String {
    let mut out = String::new();
    let mut rest = source;
    while let Some(at) = rest.find(open) {
        let end = at + rest[at..].find(']').expect("a closed bracket") + 1;
        out += &rest[..at];
        out += &format!("from_halves({})", &rest[at..end]);
        rest = &rest[end..];
    }
    out + rest
}
