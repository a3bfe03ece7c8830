//! The borders between the bands of devices, moved by the times of the last frame.

use crate::render::band::Band;

/// The part of the time of the slowest device by which new borders must be better than the present ones. Times of
/// equal frames differ by less, so that borders of a view at rest do not move.
const GAIN: f64 = 0.03;

/// Divides the rows of pictures among devices, in their order.
///
/// The time of a row is taken as constant within the last band of a device. Borders are moved to where all devices
/// would then take equally long, if that is better by [`GAIN`]. A slow device gets fewer rows likewise.
#[derive(Clone, Debug)]
pub struct Balance {
    devices: usize,
    /// The time of each row, as bands with equal times of all rows: end in parts of the height, time in parts of the
    /// whole time. The last one ends at 1.
    costs: Vec<[f64; 2]>,
    last: Option<Last>,
}

/// The borders of the last frame, and the size for which they hold.
#[derive(Clone, Debug)]
struct Last {
    height: u32,
    unit: u32,
    borders: Vec<u32>,
}

impl Balance {
    pub fn new(devices: usize) -> Self {
        Self { devices, costs: vec![[1.0, 1.0]], last: None }
    }

    /// The bands of a picture of `height` rows, whose borders are multiples of `unit` rows. There are fewer bands than
    /// devices if there are fewer units.
    pub fn bands(&mut self, height: u32, unit: u32) -> Vec<Band> {
        let last = self.last.as_ref().filter(|last| last.height == height && last.unit == unit);
        let borders = last.map_or_else(|| self.borders(height, unit), |last| last.borders.clone());
        self.last = Some(Last { height, unit, borders: borders.clone() });
        Band::between(&borders, height)
    }

    /// Takes over the times of the bands of the last frame, in any unit.
    pub fn learn(&mut self, times: &[f64]) {
        let Some(Last { height, unit, borders }) = self.last.take() else { return };
        let (whole, slowest) = (times.iter().sum::<f64>(), times.iter().copied().fold(0.0, f64::max));
        if !whole.is_normal() || times.len() != borders.len() + 1 {
            self.last = Some(Last { height, unit, borders });
            return;
        }
        let ends = borders.iter().map(|border| f64::from(*border) / f64::from(height)).chain([1.0]);
        self.costs = ends.zip(times).map(|(end, time)| [end, time / whole]).collect();
        let moved = self.borders(height, unit);
        let expected = Band::between(&moved, height).into_iter().map(|band| self.cost(band, height));
        let expected = expected.fold(0.0, f64::max) * whole;
        let borders = if expected < (1.0 - GAIN) * slowest { moved } else { borders };
        self.last = Some(Last { height, unit, borders });
    }

    /// The borders at which all devices take equally long, rounded to units. Every band has a unit at least.
    fn borders(&self, height: u32, unit: u32) -> Vec<u32> {
        let units = height.div_ceil(unit);
        let bands = (self.devices as u32).min(units);
        let mut borders = Vec::new();
        for band in 1..bands {
            let place = self.place_of(f64::from(band) / f64::from(bands)) * f64::from(height) / f64::from(unit);
            let least = borders.last().map_or(1, |border| border / unit + 1);
            borders.push((place.round() as u32).clamp(least, units - (bands - band)) * unit);
        }
        borders
    }

    /// Where the rows above have this part of the whole time, in parts of the height.
    fn place_of(&self, part: f64) -> f64 {
        let (mut begin, mut before) = (0.0, 0.0);
        for [end, time] in &self.costs {
            if before + time >= part {
                return begin + (end - begin) * (part - before) / time.max(f64::MIN_POSITIVE);
            }
            (begin, before) = (*end, before + time);
        }
        1.0
    }

    /// The part of the whole time that a band takes.
    fn cost(&self, band: Band, height: u32) -> f64 {
        let [top, end] = [band.top, band.top + band.rows].map(|row| f64::from(row) / f64::from(height));
        let mut begin = 0.0;
        let mut sum = 0.0;
        for [next, time] in &self.costs {
            sum += time * (end.min(*next) - top.max(begin)).max(0.0) / (next - begin);
            begin = *next;
        }
        sum
    }
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
