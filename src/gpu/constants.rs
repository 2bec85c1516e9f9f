//! Every constant that shaders and host share, once. [`prelude`] hands them to WGSL.

use std::fmt::Write;

use crate::gaussians::SH_0;

/// Threads a workgroup, in every kernel but one ([`LOSS_GROUP`]).
pub const WORKGROUP: u32 = 64;
/// Width of a tile that a thread owns, pixels, four a vector.
pub const TILE_W: u32 = 4;
/// Height of a tile, pixels.
pub const TILE_H: u32 = 8;
/// Side of a tile that a workgroup owns, pixels, four a thread.
pub const GROUP_TILE: u32 = 16;
const _: () = assert!(GROUP_TILE * GROUP_TILE == 4 * WORKGROUP, "a tile is full");
/// Tiles across a block, within which tiles are ordered: one a thread of a workgroup.
pub const BLOCK_W: u32 = 16;
/// Tiles down a block.
pub const BLOCK_H: u32 = WORKGROUP / BLOCK_W;
/// Counts that a thread sums serially in scans and sums.
pub const SCAN_CHUNK: u32 = 32;
/// Blocks of WORKGROUP chunks that one workgroup scans alone.
pub const SCAN_FEW: u32 = 4;
/// Entries that a thread of a radix sort moves; below 256, as it counts them in 8 bits.
pub const RADIX_CHUNK: u32 = 128;
/// Bits of a radix sort's digit.
pub const RADIX_BITS: u32 = 4;
/// Values of a digit.
pub const RADIX_DIGITS: u32 = 1 << RADIX_BITS;
/// Entries that a workgroup of a radix sort moves.
pub const GROUP_RADIX_CHUNK: u32 = 1024;
/// Bits of the digit of such a sort, which takes half of them at a time.
pub const GROUP_RADIX_BITS: u32 = 8;
/// Values of such a digit.
pub const GROUP_RADIX_DIGITS: u32 = 1 << GROUP_RADIX_BITS;
const _: () = assert!(
    GROUP_RADIX_CHUNK / WORKGROUP == 1 << (GROUP_RADIX_BITS / 2),
    "a thread has as many entries as there are halves of a digit"
);
/// Bits of a depth key, the key of the sort by depth.
pub const DEPTH_BITS: u32 = 32;
/// Sorted pairs that a thread looks through for the ends of tiles.
pub const RANGE_CHUNK: u32 = 16;
/// Most pairs that a thread emits.
pub const EMIT_CHUNK: u32 = 16;
const _: () = assert!(
    EMIT_CHUNK * WORKGROUP == GROUP_RADIX_CHUNK,
    "a workgroup emits a block of the sort by tile"
);
/// Pairs of one Gaussian that are summed to one before their Gaussian adds them up, and such sums
/// again.
pub const PAIR_BLOCK: u32 = 32;
/// Entries of a tile's list that a rasterizer takes in one dispatch; longer lists are sliced.
pub const LIST_SLICE: u32 = 32_000;
/// Turns that all loops of an invocation may take together: Mesa's CPU driver ends them then, in
/// silence (`LP_MAX_TGSI_LOOP_ITERATIONS`). A loop takes one more than its bound says, to find its
/// end, and a loop within it takes the most of any thread that runs in lockstep.
pub const LOOP_TURNS: u32 = 65_535;
/// Rows of tiles of the tallest image: a thread that emits walks them for each of its splats, up to
/// `EMIT_CHUNK`, two turns a row, after a search of 32 and 32.
pub const MOST_TILE_ROWS: u32 = 2000;
/// Threads that a driver that counts turns may run in lockstep.
const LOCKSTEP: u32 = 16;
const _: () = assert!(
    EMIT_CHUNK * (2 * MOST_TILE_ROWS + 68) + LOCKSTEP * EMIT_CHUNK < LOOP_TURNS,
    "emission ends"
);
const _: () = assert!(2 * LIST_SLICE + 2 < LOOP_TURNS, "a slice's two loops end");
/// Vectors of four pixels that a thread of SSIM's horizontal passes goes along.
pub const SSIM_ACROSS: u32 = 16;
/// Rows that a thread of SSIM's vertical passes goes down.
pub const SSIM_ROWS: u32 = 32;
/// Rows that it goes down at a time. More of them take longer to compile, fewer as long to run.
pub const SSIM_TURN: u32 = 2;
/// Rows that the windows of such a turn reach.
const SSIM_RING: u32 = SSIM_TURN + LOSS_MARGIN;
const _: () = assert!(
    SSIM_ROWS.is_multiple_of(SSIM_TURN)
        && TILE_H.is_multiple_of(SSIM_TURN)
        && SSIM_RING.is_multiple_of(SSIM_TURN),
    "turns end with the rows, and with those of the padded image, and read whole turns"
);
/// Zeros before and behind the window in its padded form: as many as stretches of four pixels
/// reach beyond it.
const WINDOW_PAD: u32 = 2 * LOSS_TURN - 1;
/// Threads a workgroup of the image losses on GPUs: columns of the strip that it marches down.
pub const LOSS_GROUP: u32 = 128;
/// Columns of a strip that are its own: those of its windows' windows.
pub const LOSS_STRIP: u32 = LOSS_GROUP - 2 * (SSIM_WINDOW as u32 - 1);
/// Rows of a strip that a workgroup owns.
pub const LOSS_ROWS: u32 = 78;
/// Rows that it goes down at a time, one a lane of a vector.
pub const LOSS_TURN: u32 = 4;
/// Rows that the windows of one row reach above and below it.
const LOSS_MARGIN: u32 = SSIM_WINDOW as u32 - 1;
/// Rows that the windows of a turn reach.
const LOSS_RING: u32 = LOSS_TURN + LOSS_MARGIN;
const _: () = assert!(
    (LOSS_ROWS + LOSS_MARGIN).is_multiple_of(LOSS_TURN),
    "turns end with the rows"
);
/// Slot of the `totals` buffer: (tile, Gaussian) pairs of the current view.
pub const TOTAL_PAIRS: u32 = 0;
/// Slot of `totals`: entries of the current radix sort.
pub const TOTAL_DIGITS: u32 = 1;
/// Slot of `totals`: number of the first step whose pairs or lists did not fit; 0: none.
pub const TOTAL_OVERFLOW: u32 = 2;
/// Slot of `totals`: most pairs of any view seen.
pub const TOTAL_MAX: u32 = 3;
/// Slot of `totals`: the longest list of those that were too long; 0: none was.
pub const TOTAL_LONGEST: u32 = 4;
/// Slot of `totals`: the current step's number.
pub const TOTAL_STEP: u32 = 5;
/// Slots of `totals`.
pub const N_TOTALS: u32 = 6;

/// Low-pass filter added to the 2D covariance's diagonal, square pixels (3DGS).
pub const DILATION: f64 = 0.3;
/// Cap of a splat's alpha (gsplat's reference).
pub const ALPHA_MAX: f64 = 0.999;
/// Largest value of 8 bits, which stands for 1 in images.
pub const LEVEL_MAX: f64 = 255.0;
/// Alpha, of 255, of a photograph's pixel that the loss of the far pixels counts.
pub const FAR_ALPHA: u32 = 254;
/// Splats fainter than this at a pixel are skipped there (3DGS).
pub const ALPHA_MIN: f64 = 1.0 / LEVEL_MAX;
/// A pixel ends before its transmittance falls to this (3DGS).
pub const TRANSMITTANCE_MIN: f64 = 1e-4;
/// Pixels by which a splat's reach is widened when tiles are listed: rounding loses no pixel.
pub const RIM: f64 = 1e-3;
/// The Jacobian's x/z and y/z are bounded to the image plus this share of its size on each side.
pub const RATIO_MARGIN: f64 = 0.15;

/// SSIM's `C1`, for values in `[0, 1]` (Wang et al. 2004).
pub const SSIM_C1: f64 = 0.01 * 0.01;
/// SSIM's `C2`, for values in `[0, 1]`.
pub const SSIM_C2: f64 = 0.03 * 0.03;
/// Side of SSIM's Gaussian window, pixels.
pub const SSIM_WINDOW: usize = 11;
/// Standard deviation of SSIM's Gaussian window, pixels.
pub const SSIM_SIGMA: f64 = 1.5;

/// Returns SSIM's window along one axis, normalised to sum 1.
pub fn ssim_window() -> [f64; SSIM_WINDOW] {
    let mut window = [0.0; SSIM_WINDOW];
    for (i, w) in window.iter_mut().enumerate() {
        let x = i as f64 - (SSIM_WINDOW / 2) as f64;
        *w = (-x * x / (2.0 * SSIM_SIGMA * SSIM_SIGMA)).exp();
    }
    let sum: f64 = window.iter().sum();
    window.map(|w| w / sum)
}

/// Returns the constants as WGSL declarations, with the active SH degree, and whether 2^x is the adapter's own.
pub fn prelude(sh_degree: u32, exp2_of_adapter: bool) -> String {
    let mut out = String::new();
    for (name, value) in [
        ("SH_DEGREE", sh_degree),
        ("WORKGROUP", WORKGROUP),
        ("TILE_W", TILE_W),
        ("TILE_H", TILE_H),
        ("GROUP_TILE", GROUP_TILE),
        ("BLOCK_W", BLOCK_W),
        ("BLOCK_H", BLOCK_H),
        ("SCAN_CHUNK", SCAN_CHUNK),
        ("SCAN_FEW", SCAN_FEW),
        ("RADIX_CHUNK", RADIX_CHUNK),
        ("RANGE_CHUNK", RANGE_CHUNK),
        ("RADIX_DIGITS", RADIX_DIGITS),
        ("GROUP_RADIX_CHUNK", GROUP_RADIX_CHUNK),
        ("GROUP_RADIX_BITS", GROUP_RADIX_BITS),
        ("GROUP_RADIX_DIGITS", GROUP_RADIX_DIGITS),
        ("EMIT_CHUNK", EMIT_CHUNK),
        ("PAIR_BLOCK", PAIR_BLOCK),
        ("LIST_SLICE", LIST_SLICE),
        ("SSIM_ACROSS", SSIM_ACROSS),
        ("SSIM_ROWS", SSIM_ROWS),
        ("LOSS_GROUP", LOSS_GROUP),
        ("LOSS_STRIP", LOSS_STRIP),
        ("LOSS_ROWS", LOSS_ROWS),
        ("LOSS_TURN", LOSS_TURN),
        ("WINDOW_PAD", WINDOW_PAD),
        ("LOSS_MARGIN", LOSS_MARGIN),
        ("LOSS_RING", LOSS_RING),
        ("SSIM_TURN", SSIM_TURN),
        ("SSIM_RING", SSIM_RING),
        ("FAR_ALPHA", FAR_ALPHA),
        ("TOTAL_PAIRS", TOTAL_PAIRS),
        ("TOTAL_OVERFLOW", TOTAL_OVERFLOW),
        ("TOTAL_MAX", TOTAL_MAX),
        ("TOTAL_LONGEST", TOTAL_LONGEST),
        ("TOTAL_STEP", TOTAL_STEP),
    ] {
        let _ = writeln!(out, "const {name} = {value}u;");
    }
    for (name, value) in [
        ("DILATION", DILATION),
        ("ALPHA_MAX", ALPHA_MAX),
        ("ALPHA_MIN", ALPHA_MIN),
        ("LEVEL_MAX", LEVEL_MAX),
        ("TRANSMITTANCE_MIN", TRANSMITTANCE_MIN),
        ("RIM", RIM),
        ("CONIC_SCALE", (0.5 * std::f64::consts::LOG2_E).sqrt()),
        ("SSIM_C1", SSIM_C1),
        ("SSIM_C2", SSIM_C2),
        ("SH_0", SH_0),
        ("SH_1", 0.4886025119029199),
        ("SH_2_0", 1.0925484305920792),
        ("SH_2_1", 0.31539156525252005),
        ("SH_2_2", 0.5462742152960396),
        ("SH_3_0", 0.5900435899266435),
        ("SH_3_1", 2.890611442640554),
        ("SH_3_2", 0.4570457994644658),
        ("SH_3_3", 0.3731763325901154),
        ("SH_3_4", 1.445305721320277),
        ("EXP2_C1", EXP2[0]),
        ("EXP2_C2", EXP2[1]),
        ("EXP2_C3", EXP2[2]),
        ("EXP2_C4", EXP2[3]),
        ("EXP2_C5", EXP2[4]),
        ("EXP2_C6", EXP2[5]),
    ] {
        let _ = writeln!(out, "const {name} = f32({value:e});");
    }
    let _ = writeln!(out, "const EXP2_OF_ADAPTER = {exp2_of_adapter};");
    let window = ssim_window();
    let _ = writeln!(
        out,
        "const WINDOW = array<f32, {SSIM_WINDOW}>({});",
        list(&window)
    );
    let mut padded = vec![0.0; SSIM_WINDOW + 2 * WINDOW_PAD as usize];
    padded[WINDOW_PAD as usize..][..SSIM_WINDOW].copy_from_slice(&window);
    let _ = writeln!(
        out,
        "const WINDOW_PADDED = array<f32, {}>({});",
        padded.len(),
        list(&padded)
    );
    out
}

/// Returns the count of a shader's `#repeat`: a constant's name or a number.
///
/// # Panics
/// On another name: a fault in this program.
pub fn repeat_count(count: &str) -> u32 {
    match count {
        "TILE_H" => TILE_H,
        "SSIM_WINDOW" => SSIM_WINDOW as u32,
        "LOSS_TURN" => LOSS_TURN,
        "LOSS_MARGIN" => LOSS_MARGIN,
        "LOSS_RING" => LOSS_RING,
        "SSIM_TURN" => SSIM_TURN,
        "SSIM_RING" => SSIM_RING,
        number => number
            .parse()
            .unwrap_or_else(|_| panic!("#repeat: no count named {number}")),
    }
}

fn list(values: &[f64]) -> String {
    values
        .iter()
        .map(|v| format!("{v:e}"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Minimax polynomial of `2^f` on `[0, 1)` with constant term 1: coefficients of `f` to `f^6`,
/// relative error 2e-9 before rounding.
const EXP2: [f64; 6] = [
    0.693147044443323,
    0.24022930555224872,
    0.055485280618589546,
    0.009675451566992522,
    0.001246784644570376,
    0.00021612914955163514,
];
