//! This module tells whether each scan of a JPEG has a code for every block (ITU-T T.81, Annexes B,
//! F and G).

use super::bits::{Bits, Stop, Table};
use super::{END_OF_IMAGE, START_OF_SCAN, Segment, Segments};

const HUFFMAN_TABLES: u8 = 0xc4;
const RESTART_INTERVAL: u8 = 0xdd;
const PROGRESSIVE: u8 = 0xc2;
/// The decoder refuses more.
const MAX_SCANS: usize = 100;

struct Component {
    id: u8,
    /// Blocks a unit of an interleaved scan, across and down.
    across: usize,
    down: usize,
    is_seen: bool,
    /// Says for each block, in rows, which coefficients are known not to be 0 (progressive).
    known: Vec<u64>,
}

/// The state of the walk: what the segments have said so far.
#[derive(Default)]
pub(super) struct Scans {
    width: usize,
    height: usize,
    is_progressive: bool,
    components: Vec<Component>,
    dc: [Option<Table>; 4],
    ac: [Option<Table>; 4],
    restart: usize,
}

/// The part of each block that a progressive scan has.
#[derive(Clone, Copy)]
struct Band {
    start: u32,
    end: u32,
    is_refining: bool,
}

impl Scans {
    /// Says what is missing, if anything is; `None`, too, if something is not understood.
    pub(crate) fn missing(mut self, segments: Segments) -> Option<String> {
        let mut n_scans = 0;
        for Segment { marker, body, data } in segments {
            match marker {
                HUFFMAN_TABLES => self.tables(body)?,
                RESTART_INTERVAL => self.restart = number(body)?,
                0xc0..=PROGRESSIVE => self.frame(body, marker == PROGRESSIVE)?,
                // Lossless, differential or arithmetic.
                0xc3 | 0xc5..=0xcb | 0xcd..=0xcf => return None,
                START_OF_SCAN => {
                    n_scans += 1;
                    if n_scans > MAX_SCANS {
                        return None;
                    }
                    let (done, of) = self.scan(body, data)?;
                    if done < of {
                        let share = 100.0 * done as f64 / of as f64;
                        return Some(format!(
                            "scan {n_scans} ends after {share:.0} % of its blocks"
                        ));
                    }
                }
                END_OF_IMAGE => {
                    let n = self.components.iter().filter(|c| !c.is_seen).count();
                    return (n > 0).then(|| {
                        format!(
                            "{n} of its {} colours are in no scan",
                            self.components.len()
                        )
                    });
                }
                _ => {}
            }
        }
        None
    }

    fn tables(&mut self, mut body: &[u8]) -> Option<()> {
        while let Some((place, rest)) = body.split_first() {
            let (counts, rest) = rest.split_first_chunk()?;
            let n = counts.iter().map(|count| usize::from(*count)).sum();
            let (symbols, rest) = rest.split_at_checked(n)?;
            let tables = if place >> 4 == 0 {
                &mut self.dc
            } else {
                &mut self.ac
            };
            *tables.get_mut(usize::from(place & 15))? = Some(Table::new(counts, symbols));
            body = rest;
        }
        Some(())
    }

    fn frame(&mut self, body: &[u8], is_progressive: bool) -> Option<()> {
        let (_bits, rest) = body.split_first()?;
        self.is_progressive = is_progressive;
        (self.height, self.width) = (number(rest)?, number(rest.get(2..)?)?);
        let component = |c: &[u8]| Component {
            id: c[0],
            across: usize::from(c[1] >> 4),
            down: usize::from(c[1] & 15),
            is_seen: false,
            known: Vec::new(),
        };
        self.components = rest.get(5..)?.chunks_exact(3).map(component).collect();
        let is_whole = |c: &Component| (1..=4).contains(&c.across) && (1..=4).contains(&c.down);
        (self.width > 0 && self.height > 0 && self.components.iter().all(is_whole)).then_some(())
    }

    /// Counts how many of its units the data of a scan has, and how many there are; one is a block
    /// where the scan has a single component.
    fn scan(&mut self, header: &[u8], data: &[u8]) -> Option<(usize, usize)> {
        let (n, rest) = header.split_first()?;
        let chosen = rest.get(..2 * usize::from(*n))?;
        let [start, end, bits] = *rest.get(chosen.len()..)?.first_chunk()?;
        let band = self.is_progressive.then_some(Band {
            start: u32::from(start),
            end: u32::from(end),
            is_refining: bits >> 4 > 0,
        });
        if band.is_some_and(|b| b.end > 63 || b.start > b.end || (b.start == 0) != (b.end == 0)) {
            return None;
        }
        let most = |side: fn(&Component) -> usize| self.components.iter().map(side).max();
        let (across, down) = (most(|c| c.across)?, most(|c| c.down)?);
        let places: Vec<(usize, &[u8])> = chosen
            .chunks_exact(2)
            .map(|c| {
                Some((
                    self.components.iter().position(|known| known.id == c[0])?,
                    c,
                ))
            })
            .collect::<Option<_>>()?;
        let (wide, high) = match places[..] {
            [] => return None,
            [(i, _)] => {
                let c = &self.components[i];
                (self.width * c.across, self.height * c.down)
            }
            _ => (self.width, self.height),
        };
        let n_units = wide.div_ceil(8 * across) * high.div_ceil(8 * down);
        // Each component's tables, and its blocks a unit.
        let mut parts = Vec::with_capacity(places.len());
        for (i, c) in &places {
            let component = &mut self.components[*i];
            component.is_seen |= band.is_none_or(|band| band.start == 0);
            let blocks = match places.len() {
                1 => 1,
                _ => component.across * component.down,
            };
            let (dc, ac) = (usize::from(c[1] >> 4), usize::from(c[1] & 15));
            parts.push((self.dc.get(dc)?.as_ref(), self.ac.get(ac)?.as_ref(), blocks));
        }
        let mut bits = Bits::new(data);
        // Blocks of a progressive scan that are still in its last run of empty ones.
        let mut run = 0;
        let mut known = match (band, &places[..]) {
            (Some(band), [(i, _)]) if band.start > 0 => {
                let mut known = std::mem::take(&mut self.components[*i].known);
                known.resize(n_units, 0);
                Some((*i, known))
            }
            (Some(band), _) if band.start > 0 => return None,
            _ => None,
        };
        let mut unit = |unit: usize| -> Result<(), Stop> {
            if self.restart > 0 && unit > 0 && unit.is_multiple_of(self.restart) {
                bits.restart()?;
                run = 0;
            }
            for (dc, ac, blocks) in &parts {
                for _ in 0..*blocks {
                    match (band, &mut known) {
                        (None, _) => sequential(&mut bits, *dc, *ac)?,
                        (Some(band), None) => first(&mut bits, *dc, band)?,
                        (Some(band), Some((_, known))) => {
                            let table = ac.ok_or(Stop::Damaged)?;
                            let known = &mut known[unit];
                            match band.is_refining {
                                false => others(&mut bits, table, band, &mut run, known)?,
                                true => refined(&mut bits, table, band, &mut run, known)?,
                            }
                        }
                    }
                }
            }
            Ok(())
        };
        let mut done = n_units;
        for i in 0..n_units {
            match unit(i) {
                Ok(()) => {}
                Err(Stop::Damaged) => return None,
                Err(Stop::Ended) => {
                    done = i;
                    break;
                }
            }
        }
        if let Some((i, known)) = known {
            self.components[i].known = known;
        }
        Some((done, n_units))
    }
}

fn number(bytes: &[u8]) -> Option<usize> {
    Some(usize::from(u16::from_be_bytes(*bytes.first_chunk()?)))
}

/// Reads a block of a sequential scan.
fn sequential(bits: &mut Bits, dc: Option<&Table>, ac: Option<&Table>) -> Result<(), Stop> {
    let (dc, ac) = dc.zip(ac).ok_or(Stop::Damaged)?;
    let size = bits.symbol(dc)?;
    skip(bits, size)?;
    let mut k = 1;
    while k < 64 {
        let symbol = bits.symbol(ac)?;
        match (symbol >> 4, symbol & 15) {
            (15, 0) => k += 16,
            (_, 0) => break,
            (zeros, size) => {
                k += u32::from(zeros) + 1;
                skip(bits, size)?;
            }
        }
    }
    Ok(())
}

/// Reads the first coefficient of a block, or its next bit.
fn first(bits: &mut Bits, dc: Option<&Table>, band: Band) -> Result<(), Stop> {
    if band.is_refining {
        return skip(bits, 1);
    }
    let size = bits.symbol(dc.ok_or(Stop::Damaged)?)?;
    skip(bits, size)
}

/// Reads the other coefficients of a block, for the first time.
fn others(
    bits: &mut Bits,
    table: &Table,
    band: Band,
    run: &mut u32,
    known: &mut u64,
) -> Result<(), Stop> {
    if *run > 0 {
        *run -= 1;
        return Ok(());
    }
    let mut k = band.start;
    while k <= band.end {
        let symbol = bits.symbol(table)?;
        match (symbol >> 4, symbol & 15) {
            (15, 0) => k += 16,
            (log, 0) => {
                *run = (1 << log) - 1 + bits.take(u32::from(log))?;
                break;
            }
            (zeros, size) => {
                k += u32::from(zeros);
                skip(bits, size)?;
                *known |= 1_u64.checked_shl(k).unwrap_or(0);
                k += 1;
            }
        }
    }
    Ok(())
}

/// Reads the next bit of each coefficient that is known, and those that become so.
fn refined(
    bits: &mut Bits,
    table: &Table,
    band: Band,
    run: &mut u32,
    known: &mut u64,
) -> Result<(), Stop> {
    let mut k = band.start;
    while *run == 0 && k <= band.end {
        let symbol = bits.symbol(table)?;
        let (mut zeros, size) = (symbol >> 4, symbol & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.take(u32::from(zeros))?;
            break;
        }
        if size > 0 {
            skip(bits, 1)?;
        }
        while k <= band.end {
            if *known >> k & 1 == 1 {
                skip(bits, 1)?;
            } else if zeros == 0 {
                break;
            } else {
                zeros -= 1;
            }
            k += 1;
        }
        if size > 0 && k <= band.end {
            *known |= 1 << k;
        }
        k += 1;
    }
    if *run > 0 {
        while k <= band.end {
            if *known >> k & 1 == 1 {
                skip(bits, 1)?;
            }
            k += 1;
        }
        *run -= 1;
    }
    Ok(())
}

fn skip(bits: &mut Bits, n: u8) -> Result<(), Stop> {
    if n > 16 {
        return Err(Stop::Damaged);
    }
    bits.take(u32::from(n)).map(|_| ())
}
