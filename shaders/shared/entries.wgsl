// What the sorts order: a key and what it belongs to, here by the names that each sort has for them.
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
