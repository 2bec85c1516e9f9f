// A radix sort whose workgroups take a chunk of entries each.
const CHUNK = GROUP_RADIX_CHUNK;
const DIGITS = GROUP_RADIX_DIGITS;
const DIGIT_BITS = GROUP_RADIX_BITS;
