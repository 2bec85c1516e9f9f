// The sorts order entries of a key and what it belongs to; here they have each sort's own names.
struct DepthEntry {
    // Orders as depths do; NOT_DRAWN behind all.
    key: u32,
    gaussian: u32,
}

struct TilePair {
    tile: u32,
    pair: u32,
}

// A range of a list, from `first` to before `end`.
struct Range {
    first: u32,
    end: u32,
}
