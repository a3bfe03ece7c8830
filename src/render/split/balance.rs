//! The borders between the bands of devices, moved by the times of the last frame.

use crate::render::band::Band;

/// The part of the time of the slowest device by which new borders must be better than the present ones. Times of
/// equal frames differ by less, so that borders of a view at rest do not move.
const GAIN: f64 = 0.03;

/// The least time of a row of cells, in parts of the mean, so that later frames can raise it.
const LEAST: f64 = 0.01;

/// Divides the rows of pictures among devices, in their order.
///
/// It keeps a time for each row of cells: those of the last band of a device are scaled so that their sum is its
/// measured time. Borders are moved to where all devices would then take equally long, if that is clearly better. A
/// slow device gets fewer rows likewise. Times of a view at rest soon agree with every band that was measured, so that
/// borders come to rest, too.
#[derive(Clone, Debug)]
pub struct Balance {
    devices: usize,
    last: Option<Last>,
}

/// The borders of the last frame, and the picture for which they hold.
#[derive(Clone, Debug)]
struct Last {
    height: u32,
    unit: u32,
    /// In units.
    borders: Vec<usize>,
    /// The times of units, in the unit of the last measurement.
    costs: Vec<f64>,
}

impl Balance {
    pub fn new(devices: usize) -> Self {
        Self { devices, last: None }
    }

    /// The bands of a picture of `height` rows, whose borders are multiples of `unit` rows. There are fewer bands than
    /// devices if there are fewer units.
    pub fn bands(&mut self, height: u32, unit: u32) -> Vec<Band> {
        let is_same = self.last.as_ref().is_some_and(|last| (last.height, last.unit) == (height, unit));
        if !is_same {
            let costs = vec![1.0; height.div_ceil(unit) as usize];
            let borders = borders(&costs, self.devices);
            self.last = Some(Last { height, unit, borders, costs });
        }
        let borders = self.last.iter().flat_map(|last| last.borders.iter().map(|border| *border as u32 * unit));
        Band::between(&Vec::from_iter(borders), height)
    }

    /// Takes over the times of the bands of the last frame, in any unit.
    pub fn learn(&mut self, times: &[f64]) {
        let Some(Last { borders: present, costs, .. }) = &mut self.last else { return };
        let slowest = times.iter().copied().fold(0.0, f64::max);
        if !slowest.is_normal() || times.len() != present.len() + 1 {
            return;
        }
        let ends = present.iter().copied().chain([costs.len()]);
        let mut begin = 0;
        for (end, time) in ends.zip(times) {
            let band = &mut costs[begin..end];
            let factor = time / band.iter().sum::<f64>();
            band.iter_mut().for_each(|cost| *cost *= factor);
            begin = end;
        }
        let least = LEAST * costs.iter().sum::<f64>() / costs.len() as f64;
        costs.iter_mut().for_each(|cost| *cost = cost.max(least));
        let moved = borders(costs, self.devices);
        let ends = moved.iter().copied().chain([costs.len()]);
        let begins = std::iter::once(0).chain(moved.iter().copied());
        let expected = begins.zip(ends).map(|(begin, end)| costs[begin..end].iter().sum::<f64>()).fold(0.0, f64::max);
        if expected < (1.0 - GAIN) * slowest {
            *present = moved;
        }
    }
}

/// The units at which the bands of all devices but the first begin, if these shall take equally long. Every band has a
/// unit at least.
fn borders(costs: &[f64], devices: usize) -> Vec<usize> {
    let bands = devices.min(costs.len());
    let whole: f64 = costs.iter().sum();
    let mut borders = Vec::new();
    let (mut unit, mut before) = (0, 0.0);
    for band in 1..bands {
        let wanted = whole * band as f64 / bands as f64;
        // A unit is above the border if more than half of it is.
        while unit < costs.len() && before + 0.5 * costs[unit] < wanted {
            before += costs[unit];
            unit += 1;
        }
        let least = borders.last().map_or(1, |border| border + 1);
        borders.push(unit.clamp(least, costs.len() - (bands - band)));
    }
    borders
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The times of bands if a row of the picture takes `row(place)`, and a device `slow[number]` times that.
    fn times(bands: &[Band], height: u32, row: impl Fn(f64) -> f64, slow: &[f64]) -> Vec<f64> {
        let of = |(band, slow): (&Band, &f64)| {
            let rows = band.top..band.top + band.rows;
            slow * rows.map(|y| row(f64::from(y) / f64::from(height))).sum::<f64>()
        };
        bands.iter().zip(slow).map(of).collect()
    }

    /// Slowest over mean.
    fn imbalance(times: &[f64]) -> f64 {
        times.iter().copied().fold(0.0, f64::max) / (times.iter().sum::<f64>() / times.len() as f64)
    }

    #[test]
    fn borders_come_to_rest_where_devices_take_equally_long() {
        let rows: [fn(f64) -> f64; 4] =
            [|_| 1.0, |y| y, |y| (-40.0 * (y - 0.3) * (y - 0.3)).exp(), |y| if y > 0.8 { 10.0 } else { 0.1 }];
        for (height, unit) in [(1080, 32), (2160, 16), (8192, 64)] {
            for devices in [1, 2, 3, 4, 8] {
                for slow in [1.0, 2.0] {
                    for row in rows {
                        let speeds: Vec<_> = (0..devices).map(|i| if i == 0 { slow } else { 1.0 }).collect();
                        let mut balance = Balance::new(devices);
                        let mut borders = Vec::new();
                        for _ in 0..30 {
                            let bands = balance.bands(height, unit);
                            assert_eq!(bands.len(), devices);
                            balance.learn(&times(&bands, height, row, &speeds));
                            borders.push(bands);
                        }
                        let (rest, last) = (&borders[28], &borders[29]);
                        assert_eq!(rest, last, "{height} rows, {devices} devices: the borders still move");
                        let costs = times(last, height, row, &speeds);
                        // One unit of the costliest rows more or less, and what is not worth a move.
                        let most = (0..100).map(|i| row(f64::from(i) / 100.0)).fold(0.0, f64::max);
                        let mean = costs.iter().sum::<f64>() / devices as f64;
                        let bound = 1.0 + 2.0 * GAIN + slow * most * f64::from(unit) / mean;
                        assert!(imbalance(&costs) < bound, "{height} {devices} {slow}: {costs:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn bands_are_whole_units_and_cover_the_picture() {
        for (height, unit, devices) in
            [(1, 16, 4), (15, 16, 2), (33, 16, 2), (50, 16, 8), (1080, 64, 17), (1080, 64, 40)]
        {
            let mut balance = Balance::new(devices);
            for times in [[1.0; 40], std::array::from_fn(|i| (i * i) as f64)] {
                let bands = balance.bands(height, unit);
                assert_eq!(bands.len(), devices.min(height.div_ceil(unit) as usize));
                let mut next = 0;
                for band in &bands {
                    assert!(band.top == next && band.rows > 0 && band.top.is_multiple_of(unit), "{bands:?}");
                    next += band.rows;
                }
                assert_eq!(next, height);
                balance.learn(&times[..bands.len()]);
            }
        }
    }

    #[test]
    fn equal_times_with_noise_move_nothing() {
        let mut balance = Balance::new(4);
        let first = balance.bands(2160, 64);
        for round in 0..1000 {
            let noise = |i: usize| 1.0 + 0.01 * f64::from((round * 7 + i as u32 * 13) % 5);
            let noisy: Vec<_> = first.iter().enumerate().map(|(i, band)| f64::from(band.rows) * noise(i)).collect();
            balance.learn(&noisy);
            assert_eq!(balance.bands(2160, 64), first);
        }
    }
}
