//! Two-level k-means: points are first divided into cells, then each cell is clustered by itself. Comparing all points
//! with all of 65,536 centroids would take hours, and existing crates offer one level only.

use rayon::prelude::*;

use crate::scene::Random;

/// Rounds of Lloyd's algorithm.
const ROUNDS: usize = 8;
/// Sampled points per cell when the cells are computed.
const SAMPLE: usize = 256;
/// Up to this number of clusters, one level is enough.
const FEW: usize = 1024;

/// At most `most` centroids, one after another, and the index of the nearest for each of `count` points. The result is
/// equal on any number of threads.
pub(crate) fn cluster<'p>(
    count: usize,
    point: impl Fn(usize) -> &'p [f32] + Sync,
    most: usize,
) -> (Vec<f32>, Vec<u16>) {
    let all: Vec<u32> = (0..count as u32).collect();
    if most <= FEW {
        let centroids = lloyd(&all, &point, most);
        let labels = all.par_iter().map(|i| centroids.nearest(point(*i as usize)).0 as u16).collect();
        return (centroids.values, labels);
    }
    let cells = (most as f64).sqrt().round() as usize;
    let step = count.div_ceil(cells * SAMPLE);
    let sample: Vec<u32> = (0..count as u32).step_by(step).collect();
    let centres = lloyd(&sample, &point, cells);
    let nearest: Vec<(usize, f32)> = all.par_iter().map(|i| centres.nearest(point(*i as usize))).collect();
    let mut members = vec![Vec::new(); centres.len()];
    all.iter().for_each(|i| members[nearest[*i as usize].0].push(*i));

    // Cells whose points are far apart get more centroids.
    let need = |members: &Vec<u32>| members.iter().map(|i| f64::from(nearest[*i as usize].1).sqrt()).sum::<f64>();
    let needs: Vec<f64> = members.iter().map(need).collect();
    let shares = shares(&needs, most - centres.len());
    let parts = members.par_iter().zip(shares).map(|(members, share)| lloyd(members, &point, 1 + share));
    let parts: Vec<Centroids> = parts.collect();

    let mut starts = vec![0];
    parts.iter().for_each(|part| starts.push(starts[starts.len() - 1] + part.len()));
    let label = |i: &u32| {
        let cell = nearest[*i as usize].0;
        (starts[cell] + parts[cell].nearest(point(*i as usize)).0) as u16
    };
    let labels = all.par_iter().map(label).collect();
    (parts.into_iter().flat_map(|part| part.values).collect(), labels)
}

/// Divides `total` in proportion to `needs`.
fn shares(needs: &[f64], total: usize) -> Vec<usize> {
    let sum: f64 = needs.iter().sum();
    let (mut before, mut given) = (0.0, 0);
    let share = needs.iter().map(|need| {
        before += need;
        let until = if sum > 0.0 { ((total as f64 * before / sum) as usize).min(total) } else { 0 };
        let share = until - given;
        given = until;
        share
    });
    share.collect()
}

/// Centroids of `width` values, one after another.
struct Centroids {
    values: Vec<f32>,
    width: usize,
    /// Half of the squared length of each.
    halves: Vec<f32>,
}

impl Centroids {
    fn new(values: Vec<f32>, width: usize) -> Self {
        let halves = values.chunks_exact(width).map(|centroid| dot(centroid, centroid) / 2.0).collect();
        Self { values, width, halves }
    }

    fn len(&self) -> usize {
        self.halves.len()
    }

    /// Index of the nearest centroid, and the square of its distance.
    fn nearest(&self, point: &[f32]) -> (usize, f32) {
        let mut best = (0, f32::INFINITY);
        for (i, (centroid, half)) in self.values.chunks_exact(self.width).zip(&self.halves).enumerate() {
            let distance = half - dot(centroid, point);
            if distance < best.1 {
                best = (i, distance);
            }
        }
        (best.0, (2.0 * best.1 + dot(point, point)).max(0.0))
    }
}

/// Lloyd's algorithm, initialized by k-means++ (Arthur and Vassilvitskii 2007): at most `most` centroids of these
/// points, and not more than there are distinct points.
fn lloyd<'p>(points: &[u32], point: &impl Fn(usize) -> &'p [f32], most: usize) -> Centroids {
    let point = |i: &u32| point(*i as usize);
    let Some(width) = points.first().map(|i| point(i).len()) else { return Centroids::new(Vec::new(), 1) };
    let mut centroids = Centroids::new(seeds(points, &point, most), width);
    if centroids.len() == points.len() {
        return centroids;
    }
    for _ in 0..ROUNDS {
        let mut sums = vec![0.0_f64; centroids.values.len()];
        let mut counts = vec![0_u32; centroids.len()];
        for i in points {
            let (nearest, _) = centroids.nearest(point(i));
            counts[nearest] += 1;
            sums[nearest * width..][..width].iter_mut().zip(point(i)).for_each(|(sum, v)| *sum += f64::from(*v));
        }
        // Centroids without a nearest point stay.
        let rows = centroids.values.chunks_exact_mut(width).zip(sums.chunks_exact(width)).zip(&counts);
        for ((centroid, sum), count) in rows.filter(|(_, count)| **count > 0) {
            centroid.iter_mut().zip(sum).for_each(|(v, sum)| *v = (sum / f64::from(*count)) as f32);
        }
        centroids = Centroids::new(centroids.values, width);
    }
    centroids
}

/// Draws points with a probability proportional to their squared distance from those drawn before (k-means++).
fn seeds<'p>(points: &[u32], point: &impl Fn(&u32) -> &'p [f32], most: usize) -> Vec<f32> {
    let mut random = Random::of(points.len());
    let mut values = point(&points[0]).to_vec();
    let mut distances = vec![f32::INFINITY; points.len()];
    let mut drawn = point(&points[0]);
    for _ in 1..most.min(points.len()) {
        let mut sum = 0.0;
        for (distance, i) in distances.iter_mut().zip(points) {
            *distance = distance.min(square(point(i), drawn));
            sum += f64::from(*distance);
        }
        if sum == 0.0 {
            break;
        }
        let mut rest = random.unit() * sum;
        let place = distances.iter().position(|distance| {
            rest -= f64::from(*distance);
            rest < 0.0
        });
        let last = distances.iter().rposition(|distance| *distance > 0.0).unwrap_or(0);
        drawn = point(&points[place.unwrap_or(last)]);
        values.extend(drawn);
    }
    values
}

const LANES: usize = 8;

/// The dot product, summed in lanes for SIMD.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    lanes(a, b, |a, b| a * b)
}

fn square(a: &[f32], b: &[f32]) -> f32 {
    lanes(a, b, |a, b| (a - b) * (a - b))
}

fn lanes(a: &[f32], b: &[f32], term: impl Fn(f32, f32) -> f32) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            sums[lane] += term(a[lane], b[lane]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| term(*a, *b)).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` points of `width` values around `centres` positions.
    fn points(count: usize, width: usize, centres: usize, spread: f64) -> Vec<f32> {
        let place = |i: usize, k: usize| 10.0 * Random::of(1000 * (i % centres) + k).unit();
        let mut random = Random::of(7);
        let value = |i: usize| (place(i / width, i % width) + spread * random.normal()) as f32;
        (0..count * width).map(value).collect()
    }

    /// Mean squared distance of the points from their centroids.
    fn error(points: &[f32], width: usize, (centroids, labels): &(Vec<f32>, Vec<u16>)) -> f64 {
        let centroid = |label: u16| &centroids[usize::from(label) * width..][..width];
        let errors = points.chunks_exact(width).zip(labels).map(|(p, label)| f64::from(square(p, centroid(*label))));
        errors.sum::<f64>() / labels.len() as f64
    }

    #[test]
    fn few_different_points_are_kept_as_they_are() {
        let points = points(5000, 9, 300, 0.0);
        for most in [512, 4096] {
            let clusters = cluster(5000, |i| &points[9 * i..][..9], most);
            assert!(clusters.0.len() <= 9 * most);
            assert_eq!(error(&points, 9, &clusters), 0.0, "{most}");
        }
    }

    #[test]
    fn clusters_are_found_where_points_are() {
        let points = points(40_000, 24, 2000, 0.01);
        let clusters = cluster(40_000, |i| &points[24 * i..][..24], 4096);
        let error = error(&points, 24, &clusters);
        // 24 values, each with a variance of 0.01 squared.
        assert!(error < 24.0 * 0.01_f64.powi(2), "{error}");
    }

    #[test]
    fn the_same_clusters_come_from_any_number_of_threads() {
        let points = points(20_000, 9, 5000, 0.1);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| cluster(20_000, |i| &points[9 * i..][..9], 2048))
        };
        assert_eq!(run(1), run(7));
    }
}
