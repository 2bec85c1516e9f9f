// A radix sort whose threads take a chunk of entries each.
const CHUNK = RADIX_CHUNK;
const DIGITS = RADIX_DIGITS;
