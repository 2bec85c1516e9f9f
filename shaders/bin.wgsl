// Finds the tiles that each splat reaches, for the rasterizers of one thread a tile.
#import shared/bin

const LIST_W = TILE_W;
const LIST_H = TILE_H;

// The sort by tile counts its digits itself.
fn emitted(tile: u32) {}

fn emitted_all(thread: Thread) {}
