// Finds the tiles that each splat reaches, in dispatches of the same code, so that all find the same tiles to the bit. The
// first (COUNT) counts the tiles of each splat; those after it write them, numbered front to back, splat by splat, and a splat
// that fills the screen is shared by many threads. Tiles are LIST_W x LIST_H pixels: the stage that imports this says how
// many, who writes what, and what else it does with each tile that it writes (`emitted`).
#import shared/thread
#import shared/view
#import shared/splat
#import shared/entries
#import shared/whole

// What a dispatch does.
struct Bin {
    // COUNT or, in bin and bin_workgroup, what is written.
    emits: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

const COUNT = 0u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
// Per splat, front to back: number of tiles, written by COUNT; the others read its first pair.
@group(0) @binding(2) var<storage, read_write> splat_pairs: array<u32>;
@group(0) @binding(4) var<storage, read_write> pairs: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> pair_gaussian: array<u32>;
@group(0) @binding(6) var<storage, read> totals: array<u32>;
@group(0) @binding(7) var<uniform> mode: Bin;
// Per Gaussian.
@group(0) @binding(3) var<storage, read_write> gaussian_pairs: array<vec2u>;
// Front to back.
@group(0) @binding(8) var<storage, read> depth_order: array<DepthEntry>;

// The ellipse |t|^2 = reach, on which a splat's alpha falls to ALPHA_MIN, with the rows of tiles that
// it meets. All is in t, in which a mean far outside is no large number.
struct Outline {
    anchor: vec2f,
    t_0: vec2f,
    l_xy: f32,
    l_yy: f32,
    inv_xx: f32,
    inv_yy: f32,
    reach: f32,
    radius: f32,
    // The rightmost point of the ellipse lies at t_y = t_right, the leftmost at -t_right.
    t_right: f32,
    // First row of tiles, one past the last.
    rows: vec2u,
}

fn outline(id: u32) -> Outline {
    let s = unpacked(splats[id]);
    var o: Outline;
    o.anchor = s.anchor;
    o.t_0 = s.t_0;
    o.l_xy = s.l_xy;
    o.l_yy = s.l_yy;
    // Rounding may not lose a pixel at the rim.
    let reach = s.reach * 1.0001 + 1e-4;
    let radius = sqrt(reach);
    let inv_yy = 1.0 / s.l_yy;
    let inv_xx = 1.0 / s.l_xx;
    let slope = -s.l_xy * inv_yy;
    o.reach = reach;
    o.radius = radius;
    o.inv_xx = inv_xx;
    o.inv_yy = inv_yy;
    o.t_right = radius * slope / sqrt(1.0 + slope * slope);
    let top = max(ceil(s.anchor.y - (s.t_0.y + radius) * inv_yy - 0.5 - RIM), 0.0);
    let bottom = min(floor(s.anchor.y - (s.t_0.y - radius) * inv_yy - 0.5 + RIM), f32(view.size.y) - 1.0);
    if (s.reach > 0.0 && top <= bottom) {
        o.rows = vec2u(whole(top) / LIST_H, whole(bottom) / LIST_H + 1u);
    }
    return o;
}

// First column and number of columns of the tiles of a row that an outline meets.
fn columns(o: Outline, row: u32) -> vec2u {
    // t_y of the pixel centres of this row of tiles.
    let t_0 = max(o.t_0.y + o.l_yy * (f32(row * LIST_H) + 0.5 - o.anchor.y), -o.radius);
    let t_1 = min(o.t_0.y + o.l_yy * (f32(row * LIST_H + LIST_H) - 0.5 - o.anchor.y), o.radius);
    let right_y = clamp(o.t_right, min(t_0, t_1), t_1);
    let left_y = clamp(-o.t_right, min(t_0, t_1), t_1);
    let right_x = o.t_0.x + o.l_xy * ((right_y - o.t_0.y) * o.inv_yy);
    let left_x = o.t_0.x + o.l_xy * ((left_y - o.t_0.y) * o.inv_yy);
    // x from the anchor.
    let right = (sqrt(max(o.reach - right_y * right_y, 0.0)) - right_x) * o.inv_xx;
    let left = -(sqrt(max(o.reach - left_y * left_y, 0.0)) + left_x) * o.inv_xx;
    let x_0 = max(ceil(o.anchor.x + left - 0.5 - RIM), 0.0);
    let x_1 = min(floor(o.anchor.x + right - 0.5 + RIM), f32(view.size.x) - 1.0);
    // Not so where one is not a number, either.
    if (!(x_0 <= x_1)) {
        return vec2u(0u);
    }
    let column = whole(x_0) / LIST_W;
    return vec2u(column, whole(x_1) / LIST_W - column + 1u);
}

// The splat that pair `pair` is of: the last of `n` whose first pair is not beyond it, `low` or
// after. Splats without pairs share their first pair with the next that has some. Steps double
// from `step` on until they go too far, then halve.
fn owner(pair: u32, low: u32, step: u32, n: u32) -> u32 {
    var rank = low;
    var ahead = step;
    // bound: 32 turns, `rank` grows by powers of two and stays below n < 2^31.
    for (; rank + ahead < n && splat_pairs[rank + ahead] <= pair; ahead *= 2u) {
        rank += ahead;
    }
    // bound: 32 turns, a power of two is halved.
    for (; ahead > 0u; ahead /= 2u) {
        if (rank + ahead < n && splat_pairs[rank + ahead] <= pair) {
            rank += ahead;
        }
    }
    return rank;
}

// Goes through the tiles of a splat of which `first` is the first pair, and writes its pairs from `begin` to before `end`; where
// it only `counts`, it writes none. Returns one past the splat's last pair or, beyond `end`, some of it.
fn walk(id: u32, first: u32, begin: u32, end: u32, counts: bool) -> u32 {
    let o = outline(id);
    let last = select(end, 0xffffffffu, counts);
    var pair = begin;
    var before = first;
    // bound: rows of tiles, held to MOST_TILE_ROWS by the host.
    for (var row = o.rows.x; row < o.rows.y; row++) {
        let span = columns(o, row);
        let stop = min(before + span.y, select(end, 0u, counts));
        let tile = row * view.tiles.x + span.x;
        // bound: EMIT_CHUNK turns over all rows together.
        for (; pair < stop; pair++) {
            pairs[pair] = stored_tile_pair(TilePair(tile + pair - before, pair));
            pair_gaussian[pair] = id;
            emitted(tile + pair - before);
        }
        before += span.y;
        if (before >= last) {
            break;
        }
    }
    return before;
}

// One past the last pair of the splat of this rank.
fn end_of(rank: u32) -> u32 {
    if (rank + 1u < view.n_gaussians) {
        return splat_pairs[rank + 1u];
    }
    return totals[TOTAL_PAIRS];
}
