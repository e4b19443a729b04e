//! Connected regions of a smoothed frame: what stands above the threshold, parted where it has more than one summit.

use super::image::above;

/// A region of pixels of an image, in image coordinates.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Region {
    /// Highest value in the region.
    pub peak: f64,
    /// Where that is: column and row.
    pub summit: [usize; 2],
    /// Pixels above its own level.
    pub area: usize,
    /// First and last column.
    pub columns: [usize; 2],
    /// First and last row.
    pub rows: [usize; 2],
    /// Mean place of its pixels, weighted by value.
    pub(crate) middle: [f64; 2],
    /// Their second moments: xx, yy, xy, px².
    pub moments: [f64; 3],
    /// The number that its pixels have in the map, from 1.
    pub label: u32,
}

impl Region {
    /// Columns and rows of its bounding box.
    pub fn extent(&self) -> [usize; 2] {
        [self.columns[1] - self.columns[0] + 1, self.rows[1] - self.rows[0] + 1]
    }

    /// Fraction of its bounding box that it fills.
    pub fn fill(&self) -> f64 {
        let [width, height] = self.extent();
        self.area as f64 / (width * height) as f64
    }

    /// The longer side of its bounding box over the shorter.
    pub fn aspect(&self) -> f64 {
        let [width, height] = self.extent().map(|n| n as f64);
        width.max(height) / width.min(height)
    }
}

/// The levels, as fractions of its summit, at which a source is cut out of what it touches; the later ones only for a lesser summit beside
/// another.
const LEVELS: [f64; 3] = [0.3, 0.6, 0.8];

/// Finds regions; holds maps as large as the image, which are empty between searches, so that a search costs what it finds.
#[derive(Debug, Default)]
pub(crate) struct Regions {
    /// Which region a pixel belongs to, from 1.
    labels: Vec<u32>,
    /// Which flood last touched a pixel.
    touched: Vec<u32>,
    flood: u32,
}

/// An image and the regions found in it so far.
struct Parting<'a> {
    image: &'a [f32],
    size: [usize; 2],
    maps: &'a mut Regions,
}

impl Regions {
    /// The regions of an image (row by row) with a summit above `threshold`, out to the level `foot`, brightest summits first within what hangs
    /// together, and their pixels with the regions' labels. (A low foot keeps a faint streak in one piece.)
    pub fn find(
        &mut self,
        image: &[f32],
        size: [usize; 2],
        threshold: f64,
        foot: f64,
    ) -> (Vec<Region>, Vec<(usize, u32)>) {
        if self.labels.len() < image.len() {
            (self.labels, self.touched) = (vec![0; image.len()], vec![0; image.len()]);
        }
        self.flood = 0;
        let mut parting = Parting { image, size, maps: self };
        let (mut found, mut labels) = (Vec::new(), Vec::new());
        for start in above(image, threshold as f32) {
            // What hangs together shares out all its pixels.
            if parting.maps.labels[start] != 0 {
                continue;
            }
            let (whole, _) = parting.pour(start, foot, None);
            parting.part(&whole, [threshold, foot], &mut found);
            labels.extend(whole.iter().map(|&pixel| (pixel, parting.maps.labels[pixel])));
        }
        for &(pixel, _) in &labels {
            (self.labels[pixel], self.touched[pixel]) = (0, 0);
        }
        (found, labels)
    }
}

impl Parting<'_> {
    /// The pixels around `start` above `level`, and whether they touch a region other than `own`.
    fn pour(&mut self, start: usize, level: f64, own: Option<u32>) -> (Vec<usize>, bool) {
        self.maps.flood += 1;
        let mut pixels = vec![start];
        self.maps.touched[start] = self.maps.flood;
        let mut taken = false;
        let mut next = 0;
        while let Some(&pixel) = pixels.get(next) {
            next += 1;
            taken |= own.is_some() && self.maps.labels[pixel] != 0;
            for neighbour in neighbours(pixel, self.size) {
                if self.maps.touched[neighbour] != self.maps.flood
                    && f64::from(self.image[neighbour]) > level
                {
                    self.maps.touched[neighbour] = self.maps.flood;
                    pixels.push(neighbour);
                }
            }
        }
        (pixels, taken)
    }

    /// The sources of one connected region: its highest summit, and each lesser one that a level parts from those before.
    fn part(&mut self, whole: &[usize], [threshold, foot]: [f64; 2], found: &mut Vec<Region>) {
        let mut summits: Vec<usize> = whole
            .iter()
            .copied()
            .filter(|&pixel| f64::from(self.image[pixel]) > threshold && self.is_summit(pixel))
            .collect();
        summits.sort_by(|&a, &b| self.image[b].total_cmp(&self.image[a]).then(a.cmp(&b)));
        let first_label = found.len() as u32 + 1;
        for summit in summits {
            if self.maps.labels[summit] != 0 {
                continue;
            }
            let peak = f64::from(self.image[summit]);
            for fraction in LEVELS {
                let level = (fraction * peak).max(foot);
                let (pixels, taken) = self.pour(summit, level, Some(first_label));
                if taken {
                    continue;
                }
                let label = found.len() as u32 + 1;
                for &pixel in &pixels {
                    self.maps.labels[pixel] = label;
                }
                found.push(self.describe(&pixels, summit, label));
                break;
            }
        }
        self.share_out(whole, first_label);
    }

    /// Assigns what is left of a connected region around its sources to the nearest of them.
    fn share_out(&mut self, whole: &[usize], first_label: u32) {
        self.maps.flood += 1;
        for &pixel in whole {
            self.maps.touched[pixel] = self.maps.flood;
        }
        let mut reached: Vec<usize> =
            whole.iter().copied().filter(|&pixel| self.maps.labels[pixel] >= first_label).collect();
        let mut next = 0;
        while let Some(&pixel) = reached.get(next) {
            next += 1;
            for neighbour in neighbours(pixel, self.size) {
                if self.maps.labels[neighbour] == 0
                    && self.maps.touched[neighbour] == self.maps.flood
                {
                    self.maps.labels[neighbour] = self.maps.labels[pixel];
                    reached.push(neighbour);
                }
            }
        }
    }

    /// Whether nothing within two pixels is higher.
    fn is_summit(&self, pixel: usize) -> bool {
        let [width, height] = self.size;
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(2)..(y + 3).min(height);
        rows.into_iter().all(|row| {
            let from = row * width + x.saturating_sub(2);
            let to = row * width + (x + 3).min(width);
            self.image[from..to].iter().all(|&v| v.is_nan() || v <= self.image[pixel])
        })
    }

    fn describe(&self, pixels: &[usize], summit: usize, label: u32) -> Region {
        let width = self.size[0];
        let place = |pixel: usize| [pixel % width, pixel / width];
        let mut region = Region {
            peak: f64::from(self.image[summit]),
            summit: place(summit),
            area: pixels.len(),
            columns: [usize::MAX, 0],
            rows: [usize::MAX, 0],
            middle: [0.0; 2],
            moments: [0.0; 3],
            label,
        };
        let mut sum = 0.0;
        for &pixel in pixels {
            let [x, y] = place(pixel);
            region.columns = [region.columns[0].min(x), region.columns[1].max(x)];
            region.rows = [region.rows[0].min(y), region.rows[1].max(y)];
            let value = f64::from(self.image[pixel]);
            sum += value;
            region.middle =
                [region.middle[0] + value * x as f64, region.middle[1] + value * y as f64];
        }
        region.middle = region.middle.map(|m| m / sum);
        for &pixel in pixels {
            let [x, y] = place(pixel);
            let d = [x as f64 - region.middle[0], y as f64 - region.middle[1]];
            let weight = f64::from(self.image[pixel]) / sum;
            region.moments[0] += weight * d[0] * d[0];
            region.moments[1] += weight * d[1] * d[1];
            region.moments[2] += weight * d[0] * d[1];
        }
        region
    }
}

/// The up to eight pixels around one.
pub(crate) fn neighbours(pixel: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    (y.saturating_sub(1)..(y + 2).min(height))
        .flat_map(move |row| columns.clone().map(move |column| row * width + column))
        .filter(move |&other| other != pixel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_hills_are_parted_and_a_ridge_is_not() {
        // Truth: drawn by hand: two normal hills five widths apart whose feet join above the threshold, and a ridge of one height.
        let size = [40, 30];
        let hill = |x: f64, y: f64, h: f64, x0: f64, y0: f64| {
            h * (-0.5 * ((x - x0).powi(2) + (y - y0).powi(2)) / 4.0).exp()
        };
        let image: Vec<f32> = (0..size[0] * size[1])
            .map(|i| {
                let (x, y) = ((i % size[0]) as f64, (i / size[0]) as f64);
                let ridge = if (22..25).contains(&(i / size[0])) { 20.0 } else { 0.0 };
                (hill(x, y, 100.0, 12.0, 10.0) + hill(x, y, 30.0, 22.0, 10.0) + ridge) as f32
            })
            .collect();
        let mut regions = Regions::default();
        let (found, labels) = regions.find(&image, size, 1.0, 0.5);
        let summits: Vec<[usize; 2]> = found.iter().map(|r| r.summit).collect();
        assert_eq!(summits[..2], [[12, 10], [22, 10]]);
        assert_eq!(found.len(), 3);
        assert_eq!((found[2].extent(), found[2].fill()), ([40, 3], 1.0));
        let label = |at| labels.iter().find(|(pixel, _)| *pixel == at).map(|(_, label)| *label);
        assert_eq!([label(10 * 40 + 12), label(10 * 40 + 22), label(0)], [Some(1), Some(2), None]);
        // Nothing is left over for the next image.
        assert_eq!(regions.find(&image, size, 1.0, 0.5), (found, labels));
        assert_eq!(regions.find(&[f32::NAN, 1.0, 1.0], [3, 1], 5.0, 2.0), (vec![], vec![]));
    }
}
