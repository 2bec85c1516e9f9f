// The sorts order entries of a key and what it belongs to; here they have each sort's own names. They
// are stored as vectors: a software driver stores and loads one as fast as one number.
struct DepthEntry {
    // Orders as depths do; NOT_DRAWN behind all.
    key: u32,
    gaussian: u32,
}

struct TilePair {
    tile: u32,
    pair: u32,
}

// What a rasterizer blends, in the order in which its tile does.
struct TileSplat {
    gaussian: u32,
    pair: u32,
}

// A range of a list, from `first` to before `end`.
struct Range {
    first: u32,
    end: u32,
}

fn stored_depth_entry(e: DepthEntry) -> vec2u {
    return vec2u(e.key, e.gaussian);
}

fn stored_tile_pair(p: TilePair) -> vec2u {
    return vec2u(p.tile, p.pair);
}

fn stored_range(r: Range) -> vec2u {
    return vec2u(r.first, r.end);
}

fn range_of(v: vec2u) -> Range {
    return Range(v.x, v.y);
}

fn stored_tile_splat(s: TileSplat) -> vec2u {
    return vec2u(s.gaussian, s.pair);
}

fn tile_splat(v: vec2u) -> TileSplat {
    return TileSplat(v.x, v.y);
}

// A tile and the range of its list.
struct TileList {
    tile: u32,
    range: Range,
}

fn stored_tile_list(l: TileList) -> vec4u {
    return vec4u(l.tile, l.range.first, l.range.end, 0u);
}

fn tile_list(v: vec4u) -> TileList {
    return TileList(v.x, Range(v.y, v.z));
}
