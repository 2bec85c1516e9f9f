// Finds the tiles that each splat reaches, for the rasterizers of one workgroup a tile.
#import shared/bin

const LIST_W = GROUP_TILE;
const LIST_H = GROUP_TILE;
