//! Which recipes are tried, where their searches begin, and which one is chosen.

use super::judge::{Found, Incidence, Judge};
use super::model::{Cone, Floor, Kind, Recipe, Rise};
use rayon::prelude::*;

/// Steps of a search that says which start leads where, of one to an end, of one whose end is judged, and to the end; and the part of the cost below which a step's gain ends it. What a score
/// differs by chance is a hundred times more than the third.
const A_LOOK: (usize, f64) = (8, 1e-3);
const TO_AN_END: (usize, f64) = (40, 1e-4);
const JUDGED: (usize, f64) = (150, 1e-6);
const TO_THE_END: (usize, f64) = (150, 1e-9);
/// The misfit of ln f from which a search begins, and the least that is reckoned with.
pub(super) const MISFIT: f64 = 0.2;
const LEAST_MISFIT: f64 = 0.005;
/// Recipes that are judged by incidences left out, of each number of parameters.
const OF_EACH: usize = 3;
/// A recipe that costs more than this many times the best one's cost is not looked at again.
const HOPELESS: f64 = 4.0;
/// A start that costs more than this many times the best one's after a look is not followed.
const TOO_FAR: f64 = 30.0;
/// A search failed whose end costs more than this part of it.
const FAILED: f64 = 0.999;
/// Incidences that are left out in turn, at most.
const FOLDS: usize = 8;
/// Parts of an incidence whose errors are taken as independent of one another.
const BLOCKS: usize = 5;
/// A simpler recipe is taken if its score is worse by less than this part, for each parameter that it has less, over the number of independent samples; and never if by more than the second
/// part.
const OF_CHANCE: f64 = 6.0;
const ALIKE: f64 = 0.08;
/// Where residuals end.
const MOST_LN: f64 = 4.0;

/// A recipe with its best numbers.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub recipe: Recipe,
    pub found: Found,
    pub weight: Vec<f64>,
    /// Per incidence left out.
    pub folds: Vec<Fold>,
}

/// Prediction of a recipe for an incidence that it was not fitted to.
#[derive(Debug, Clone)]
pub(super) struct Fold {
    pub incidence: usize,
    pub interior: bool,
    /// ln f measured − seen.
    pub residual: Vec<f64>,
    pub hemispherical: f64,
    pub peak: Option<f64>,
    /// Cost of the hemispherical reflectance and of the peak.
    figures: f64,
}

impl Fold {
    /// Returns the score by blocks of neighbours: mean squares of ln f, and the cost of reflectance and peak.
    fn blocks(&self) -> Vec<f64> {
        let figures = self.figures;
        let size = self.residual.len().div_ceil(BLOCKS).max(1);
        let mean = |part: &[f64]| {
            part.iter().map(|r| r.clamp(-MOST_LN, MOST_LN).powi(2)).sum::<f64>() / part.len() as f64
        };
        self.residual.chunks(size).map(|part| mean(part) + figures).collect()
    }
}

/// Lobes that are tried together.
fn lobes() -> Vec<Vec<Kind>> {
    use Kind::{Abg, Beckmann, Ggx};
    vec![
        vec![],
        vec![Ggx],
        vec![Beckmann],
        vec![Abg],
        vec![Ggx, Ggx],
        vec![Beckmann, Ggx],
        vec![Beckmann, Beckmann],
        vec![Abg, Abg],
        vec![Abg, Ggx],
    ]
}

/// All recipes of up to two lobes that a table of several incidences can tell apart.
pub(super) fn recipes(most_lobes: usize) -> Vec<Recipe> {
    let mut all = Vec::new();
    for lobes in lobes().into_iter().filter(|l| l.len() <= most_lobes) {
        for floor in [Floor::None, Floor::Lambert, Floor::Falling] {
            for mirror in [false, true] {
                for rise in [Rise::Constant, Rise::Schlick, Rise::Dielectric] {
                    let specular = mirror || !lobes.is_empty();
                    let is_nothing = !specular && floor == Floor::None;
                    if is_nothing || (!specular && rise != Rise::Constant) {
                        continue;
                    }
                    // A mirror alone has no wings.
                    if mirror && lobes.is_empty() && floor == Floor::None {
                        continue;
                    }
                    all.push(Recipe { lobes: lobes.clone(), mirror, rise, floor });
                }
            }
        }
    }
    all
}

/// Numbers at which a search may begin, in logarithms.
fn starts(judge: &Judge<'_>) -> Vec<Vec<f64>> {
    let recipe = judge.recipe;
    let widths: &[&[f64]] = match recipe.lobes.len() {
        0 => &[&[]],
        1 => &[&[0.008], &[0.03], &[0.1], &[0.3], &[0.6]],
        2 => {
            &[&[0.006, 0.06], &[0.02, 0.15], &[0.06, 0.3], &[0.15, 0.5], &[0.01, 0.4], &[0.2, 0.03]]
        }
        _ => &[&[0.01, 0.06, 0.3], &[0.02, 0.15, 0.5], &[0.06, 0.02, 0.3]],
    };
    let rises: &[f64] = match recipe.rise {
        Rise::Constant => &[1.0],
        Rise::Schlick => &[0.1],
        Rise::Dielectric | Rise::Polarised => &[1.7],
    };
    let ranges = recipe.ranges();
    let mut all = Vec::new();
    for widths in widths {
        for rise in rises {
            let p: Vec<f64> = ranges
                .iter()
                .map(|r| {
                    let width = r.lobe.checked_sub(1).and_then(|k| widths.get(k)).copied();
                    let width = width.unwrap_or(0.1);
                    let value = match r.key {
                        "reflectance" | "n" => *rise,
                        "alpha" => width,
                        "g" => 2.0,
                        "b" => (2.0 * width).powi(2),
                        "in_plane_share" => 0.5,
                        "mirror_g" => 0.5,
                        "mirror_alpha" => 2e-3,
                        "diffuse_power" => 0.5,
                        // Shares: balanced below.
                        _ => 0.05,
                    };
                    value.clamp(r.least, r.most)
                })
                .collect();
            all.push(balanced(judge, p));
        }
    }
    all
}

/// Shares and reflectances that are about right for the shapes: maximum likelihood of a sum of known parts under errors that are alike in proportion, by the multiplicative update that
/// keeps each positive (Févotte and Idier 2011).
fn balanced(judge: &Judge<'_>, mut p: Vec<f64>) -> Vec<f64> {
    let ranges = judge.recipe.ranges();
    let strengths: Vec<usize> = (0..p.len())
        .filter(|k| matches!(ranges[*k].key, "share" | "mirror_share" | "diffuse"))
        .collect();
    let mut parts: Vec<Vec<f64>> = Vec::new();
    for k in &strengths {
        let mut alone = p.clone();
        for other in &strengths {
            alone[*other] = if other == k { 1.0 } else { 0.0 };
        }
        let surface = judge.recipe.with(&alone);
        let all = judge.incidences.iter().flat_map(|i| {
            let seen = i.seen(&surface, judge.blur2);
            let bright = seen.into_iter().zip(&i.value).filter(|(_, v)| **v > i.equal_per_sr);
            bright.map(|(s, v)| s / v).collect::<Vec<_>>()
        });
        parts.push(all.collect());
    }
    let mut c: Vec<f64> = parts
        .iter()
        .map(|part| {
            let sum: f64 = part.iter().sum();
            if sum > 0.0 { part.len() as f64 / sum / parts.len() as f64 } else { 1e-6 }
        })
        .collect();
    let count = parts.first().map_or(0, Vec::len);
    for _ in 0..60 {
        let whole: Vec<f64> =
            (0..count).map(|k| parts.iter().zip(&c).map(|(p, c)| p[k] * c).sum()).collect();
        for (part, c) in parts.iter().zip(&mut c) {
            let (mut up, mut down) = (0.0, 0.0);
            for (p, w) in part.iter().zip(&whole) {
                let w = w.max(1e-12);
                up += p / (w * w);
                down += p / w;
            }
            if down > 0.0 {
                *c *= (up / down).sqrt();
            }
        }
    }
    for (k, c) in strengths.iter().zip(c) {
        p[*k] = c.clamp(ranges[*k].least.max(1e-5), 0.9 * ranges[*k].most);
    }
    p.iter().map(|p| p.ln()).collect()
}

/// Where the starts of a recipe lead within a few steps, the best first.
fn looks(judge: &mut Judge<'_>) -> Vec<Found> {
    let mut looks: Vec<Found> = starts(judge).iter().map(|x| judge.solve(x, A_LOOK)).collect();
    looks.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    looks.dedup_by(|a, b| (a.cost - b.cost).abs() < 1e-3 * b.cost);
    looks.truncate(2);
    looks
}

/// Goes on from given numbers, with outliers weighed.
fn refine(
    recipe: &Recipe,
    incidences: &[&Incidence],
    (cone, misfit): (&Cone, f64),
    (from, to): (&[f64], (usize, f64)),
    rounds: usize,
) -> (Found, Vec<f64>) {
    let mut judge = Judge::new(recipe, incidences.to_vec(), cone, misfit);
    let mut best = judge.solve(from, to);
    for _ in 0..rounds {
        judge.weigh(&best.x);
        best = judge.solve(&best.x, to);
    }
    (best, judge.weight)
}

/// All recipes, each with its best numbers, the cheapest first.
pub(super) fn all(
    recipes: &[Recipe],
    incidences: &[&Incidence],
    (cone, misfit): (&Cone, f64),
    done: &(dyn Fn() + Sync),
) -> Vec<Candidate> {
    let judge = |recipe| Judge::new(recipe, incidences.to_vec(), cone, misfit);
    let looks: Vec<(&Recipe, Vec<Found>)> =
        recipes.par_iter().map(|recipe| (recipe, looks(&mut judge(recipe)))).collect();
    let least = looks.iter().filter_map(|(_, l)| Some(l.first()?.cost)).fold(f64::MAX, f64::min);
    let mut found: Vec<Candidate> = looks
        .into_par_iter()
        .filter_map(|(recipe, looks)| {
            let mut judge = judge(recipe);
            let ends = looks.into_iter().map(|look| {
                let is_far = look.cost > TOO_FAR * least;
                if is_far { look } else { judge.solve(&look.x, TO_AN_END) }
            });
            let found = ends.min_by(|a, b| a.cost.total_cmp(&b.cost))?;
            done();
            Some(Candidate { recipe: recipe.clone(), found, weight: Vec::new(), folds: Vec::new() })
        })
        .collect();
    nested(&mut found, incidences, (cone, misfit));
    found.sort_by(|a, b| a.found.cost.total_cmp(&b.found.cost));
    found
}

/// A recipe is never worse than one that it contains: where its search ended higher, it begins anew at that one's end.
fn nested(found: &mut [Candidate], incidences: &[&Incidence], (cone, misfit): (&Cone, f64)) {
    let sizes: std::collections::BTreeSet<usize> = found.iter().map(|c| c.found.x.len()).collect();
    for size in sizes {
        let better: Vec<(usize, Found)> = (0..found.len())
            .into_par_iter()
            .filter(|k| found[*k].found.x.len() == size)
            .filter_map(|k| {
                let whole = &found[k];
                let parts = found.iter().filter(|c| {
                    c.found.cost < FAILED * whole.found.cost
                        && c.recipe.without(&whole.recipe).is_some()
                });
                let part = parts.min_by(|a, b| a.found.cost.total_cmp(&b.found.cost))?;
                let mut judge = Judge::new(&whole.recipe, incidences.to_vec(), cone, misfit);
                let mut best: Option<Found> = None;
                for start in grown(&judge, part) {
                    let end = judge.solve(&start, TO_AN_END);
                    if best.as_ref().is_none_or(|b| end.cost < b.cost) {
                        best = Some(end);
                    }
                }
                Some((k, best.filter(|b| b.cost < whole.found.cost)?))
            })
            .collect();
        for (k, end) in better {
            found[k].found = end;
        }
    }
}

/// Starts of a recipe at the end of one that lacks one of its parts.
fn grown(judge: &Judge<'_>, part: &Candidate) -> Vec<Vec<f64>> {
    const WIDTHS: [f64; 4] = [0.02, 0.1, 0.3, 0.8];
    let ranges = judge.recipe.ranges();
    let known = part.recipe.ranges();
    // The number of the lobe that it lacks; 0 where it lacks another part.
    let lacks = part.recipe.without(judge.recipe).unwrap_or(0);
    let widths = if lacks > 0 { &WIDTHS[..] } else { &WIDTHS[..1] };
    let start = |width: &f64| {
        let p = ranges.iter().map(|r| {
            let lobe = if lacks > 0 && r.lobe > lacks { r.lobe - 1 } else { r.lobe };
            let is_new = lacks > 0 && r.lobe == lacks;
            let same = known.iter().position(|k| !is_new && k.key == r.key && k.lobe == lobe);
            let value = match (same, r.key) {
                (Some(k), _) => part.found.x[k].exp(),
                (None, "alpha") => *width,
                (None, "b") => (2.0 * width).powi(2),
                (None, "g") => 2.0,
                (None, "mirror_g" | "diffuse_power" | "in_plane_share") => 0.5,
                (None, "mirror_alpha") => 2e-3,
                (None, _) => 0.05,
            };
            value.clamp(r.least, r.most)
        });
        balanced(judge, p.collect())
    };
    widths.iter().map(start).collect()
}

/// The best recipes with a dielectric, in polarised light.
pub(super) fn polarised(candidates: &[Candidate]) -> Vec<Recipe> {
    let mut counts = std::collections::BTreeMap::new();
    let mut all = Vec::new();
    for candidate in candidates.iter().filter(|c| c.recipe.rise == Rise::Dielectric) {
        let count = counts.entry(candidate.found.x.len()).or_insert(0_usize);
        if *count < OF_EACH && !candidate.recipe.lobes.is_empty() {
            *count += 1;
            all.push(Recipe { rise: Rise::Polarised, ..candidate.recipe.clone() });
        }
    }
    all
}

/// Brings the numbers of a recipe to their end.
pub(super) fn to_the_end(
    candidate: &mut Candidate,
    incidences: &[&Incidence],
    (cone, misfit): (&Cone, f64),
) {
    let from = (candidate.found.x.as_slice(), TO_THE_END);
    (candidate.found, candidate.weight) =
        refine(&candidate.recipe, incidences, (cone, misfit), from, 2);
}

/// The misfit of ln f, rms, of the best one.
pub(super) fn misfit(candidates: &[Candidate], incidences: &[&Incidence], cone: &Cone) -> f64 {
    let of = |c: &Candidate| {
        let judge = Judge::new(&c.recipe, incidences.to_vec(), cone, 1.0);
        let r = judge.samples(&judge.surface(&c.found.x));
        (r.iter().map(|r| r * r).sum::<f64>() / r.len().max(1) as f64).sqrt()
    };
    candidates.iter().take(3).map(of).fold(MISFIT, f64::min).max(LEAST_MISFIT)
}

/// Brings candidates to their ends with all samples.
pub(super) fn finish(
    candidates: &mut [Candidate],
    incidences: &[&Incidence],
    cone: &Cone,
    misfit: f64,
) {
    candidates.par_iter_mut().for_each(|c| {
        (c.found, c.weight) =
            refine(&c.recipe, incidences, (cone, misfit), (&c.found.x, JUDGED), 2);
    });
    candidates.sort_by(|a, b| a.found.cost.total_cmp(&b.found.cost));
}

/// The recipes that are worth leaving incidences out: the best few of each number of parameters. No number in all ends it: where a simple recipe is the true one, all that contain it cost
/// as little or a little less, and it would be the one that is left.
pub(super) fn shortlist(candidates: Vec<Candidate>) -> (Vec<Candidate>, Vec<Candidate>) {
    let best = candidates.first().map_or(f64::INFINITY, |c| c.found.cost);
    let mut counts = std::collections::BTreeMap::new();
    let (mut kept, mut left) = (Vec::new(), Vec::new());
    for candidate in candidates {
        let size = candidate.found.x.len();
        let count = counts.entry(size).or_insert(0_usize);
        // Noise alone gives a floor below which costs are alike.
        let hopes = candidate.found.cost <= HOPELESS * best;
        if hopes && *count < OF_EACH {
            *count += 1;
            kept.push(candidate);
        } else {
            left.push(candidate);
        }
    }
    (kept, left)
}

/// Leaves out one incidence at a time.
pub(super) fn leave_out(
    candidates: &mut [Candidate],
    incidences: &[Incidence],
    cone: &Cone,
    misfit: f64,
) {
    let count = incidences.len();
    if count < 2 {
        return;
    }
    let left: Vec<usize> = if count <= FOLDS {
        (0..count).collect()
    } else {
        (0..FOLDS).map(|k| k * (count - 1) / (FOLDS - 1)).collect()
    };
    let tasks: Vec<(usize, usize)> =
        (0..candidates.len()).flat_map(|c| left.iter().map(move |l| (c, *l))).collect();
    let folds: Vec<(usize, Fold)> = tasks
        .par_iter()
        .map(|(c, l)| {
            let candidate = &candidates[*c];
            let others: Vec<&Incidence> =
                incidences.iter().enumerate().filter(|(k, _)| k != l).map(|(_, i)| i).collect();
            let from = (candidate.found.x.as_slice(), JUDGED);
            let (found, _) = refine(&candidate.recipe, &others, (cone, misfit), from, 1);
            let judge = Judge::new(&candidate.recipe, vec![&incidences[*l]], cone, misfit);
            let surface = judge.surface(&found.x);
            let seen = incidences[*l].seen(&surface, judge.blur2);
            let (hemispherical, peak) = incidences[*l].ratios(&seen);
            let residual = judge.samples(&surface);
            let interior = *l > 0 && *l + 1 < count;
            let figures = judge.figures(&incidences[*l], hemispherical, peak);
            (*c, Fold { incidence: *l, interior, residual, hemispherical, peak, figures })
        })
        .collect();
    for (c, fold) in folds {
        candidates[c].folds.push(fold);
    }
}

/// The mean score over all that was left out, lower is better; interior incidences count twice.
pub(super) fn score(candidate: &Candidate) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for fold in &candidate.folds {
        let blocks = fold.blocks();
        let w = if fold.interior { 2.0 } else { 1.0 };
        sum += w * blocks.iter().sum::<f64>() / blocks.len().max(1) as f64;
        weight += w;
    }
    if weight > 0.0 { sum / weight } else { f64::INFINITY }
}

/// Part of the best score in plain light that a recipe in polarised light has to stay below.
const PLAINLY: f64 = 0.7;

/// The simplest candidate that is not worse than the best one by more than chance explains. Each is judged by both its fit and by what it says of incidences left out; `independent` is as how
/// many samples count.
pub(super) fn choose(candidates: &[Candidate], independent: f64) -> Option<usize> {
    // Of one incidence none can be left out: its fit alone counts.
    let left_out = |c: &Candidate| if c.folds.is_empty() { 0.0 } else { score(c) };
    let mut scores: Vec<f64> = candidates.iter().map(|c| c.found.cost + left_out(c)).collect();
    // Polarisation is the instrument's, and in doubt the source had none: any small misfit of the law would be taken for it.
    let is_polarised = |k: usize| candidates[k].recipe.rise == Rise::Polarised;
    let plain = (0..scores.len()).filter(|k| !is_polarised(*k)).map(|k| scores[k]);
    let plain = plain.fold(f64::INFINITY, f64::min);
    for k in (0..scores.len()).filter(|k| is_polarised(*k)) {
        if scores[k] > PLAINLY * plain {
            scores[k] = f64::INFINITY;
        }
    }
    let best = (0..candidates.len()).min_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let size = |k: usize| candidates[k].found.x.len();
    let alike = |k: &usize| {
        let fewer = size(best).saturating_sub(size(*k)) as f64;
        let part = (OF_CHANCE * fewer / independent.max(1.0)).min(ALIKE);
        scores[*k] <= scores[best] * (1.0 + part)
    };
    (0..candidates.len()).filter(alike).min_by(|a, b| {
        (size(*a), scores[*a])
            .partial_cmp(&(size(*b), scores[*b]))
            .unwrap_or(std::cmp::Ordering::Equal)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: of recipes that all fit alike, each part more gaining a thousandth as noise lets it, the simplest is the true one, and must be among those that are judged. The others with its parts are more than two dozen, in as
    /// many sizes as a real search has.
    #[test]
    fn the_simplest_of_many_that_fit_alike_is_judged() {
        let simplest = Recipe {
            lobes: vec![Kind::Ggx],
            mirror: false,
            rise: Rise::Constant,
            floor: Floor::Lambert,
        };
        let contains =
            |recipe: &Recipe| recipe.lobes.contains(&Kind::Ggx) && recipe.floor != Floor::None;
        let candidate = |recipe: Recipe| {
            let x = vec![0.0; recipe.ranges().len()];
            let found = Found { cost: 1.0 - 1e-3 * x.len() as f64, x };
            Candidate { recipe, found, weight: Vec::new(), folds: Vec::new() }
        };
        let mut candidates: Vec<Candidate> =
            recipes(2).into_iter().filter(contains).map(candidate).collect();
        candidates.extend(polarised(&candidates).into_iter().map(candidate));
        candidates.sort_by(|a, b| a.found.cost.total_cmp(&b.found.cost));
        let count = candidates.len();
        let (kept, left) = shortlist(candidates);
        assert_eq!(kept.len() + left.len(), count);
        // A limit of 24 in all was what left it out.
        let place = kept.iter().position(|c| c.recipe == simplest);
        assert!(place.is_some_and(|place| place >= 24), "{place:?} of {} of {count}", kept.len());
        let of_size = |n: usize| kept.iter().filter(|c| c.found.x.len() == n).count();
        assert!((1..20).all(|n| of_size(n) <= OF_EACH) && !left.is_empty());
    }
}
