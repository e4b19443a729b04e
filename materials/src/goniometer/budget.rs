//! Plans within a budget: so many directions, or as many as a bench measures in a time.

use super::bench::Bench;
use super::pose::Kinematics;
use super::tasks::{Part, Tasks, reading_s, stages, tasks};
use crate::ndf::Ndf;
use crate::plan::{Choice, LEAST, Plan, PlanError, Times};
use sunglint_numerics::progress::Progress;

/// Directions that are put in order first where the time says how many there will be.
const FIRST: usize = 100;

/// Limit of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Number of directions.
    Directions(usize),
    /// Time of the whole run, the instrument's own measurements included, hours.
    Hours(f64),
}

/// Chooses those directions of a plan that tell most, among those that a bench reaches, as many as the budget allows.
///
/// # Errors
/// A budget of fewer directions than a material needs, of more than there are, of less time than the bench needs for itself; a bench that reaches nothing; the work was ended.
pub fn within_budget(
    plan: &Plan,
    ndf: &Ndf,
    bench: &Bench,
    budget: Budget,
    progress: &dyn Progress,
) -> Result<Plan, PlanError> {
    let kinematics = Kinematics::new(bench);
    let planned = plan.planned();
    let reached: Vec<bool> =
        planned.iter().map(|one| stages(bench, &kinematics, one).is_some()).collect();
    let directions = reached.iter().filter(|reached| **reached).count();
    if directions == 0 {
        return Err(PlanError::Unreachable { cells: plan.cells.len() });
    }
    let own = tasks(bench, &kinematics, &[]).estimate_s;
    let most = match budget {
        Budget::Directions(asked) if asked < LEAST => return Err(PlanError::TooFew { asked }),
        Budget::Directions(asked) if asked > directions => {
            return Err(PlanError::TooMany { asked, directions });
        }
        Budget::Directions(asked) => asked,
        Budget::Hours(hours) => {
            let most = ((3600.0 * hours - own) / reading_s(bench)).clamp(0.0, directions as f64);
            (most as usize).max(LEAST).min(directions)
        }
    };
    let choose = |count: usize| Choice::new(plan, ndf, &reached, count, progress);
    let of = |choice: &Choice, count: usize| {
        let mut made = choice.plan(plan, count)?;
        let times = times(&tasks(bench, &kinematics, &made.planned()), own);
        if let Some(chosen) = &mut made.chosen {
            chosen.times = Some(times);
        }
        Ok::<(Plan, f64), PlanError>((made, times.total_s))
    };
    let Budget::Hours(hours) = budget else { return Ok(of(&choose(most)?, most)?.0) };
    // Ways and references count, too: few are put in order until their time tells about how many there will be.
    let mut asked = FIRST.min(most);
    let mut choice = choose(asked)?;
    let (mut found, least_s) = of(&choice, LEAST)?;
    if least_s > 3600.0 * hours {
        let (own_h, least_h) = (own / 3600.0, least_s / 3600.0);
        return Err(PlanError::TooShort { asked_h: hours, own_h, least_h });
    }
    let mut low = LEAST;
    let mut high = loop {
        let (made, total_s) = of(&choice, asked)?;
        if total_s > 3600.0 * hours {
            break asked;
        }
        (low, found) = (asked, made);
        if asked == most {
            break asked + 1;
        }
        // The more there are, the shorter is the way from one to the next.
        let each_s = (total_s - own) / asked as f64;
        let more = 1.2 * (3600.0 * hours - own) / each_s;
        asked = (more as usize).max(asked + asked / 2).min(most);
        choice = choose(asked)?;
    };
    while high - low > 1 {
        let middle = usize::midpoint(low, high);
        let (made, total_s) = of(&choice, middle)?;
        if total_s > 3600.0 * hours {
            high = middle;
        } else {
            low = middle;
            found = made;
        }
    }
    Ok(found)
}

fn times(list: &Tasks, own_s: f64) -> Times {
    let count = |of: &dyn Fn(Part) -> bool| list.tasks.iter().filter(|t| of(t.part)).count();
    Times {
        references: count(&|part| part == Part::Reference),
        instrument: count(&|part| !matches!(part, Part::Reference | Part::Direction)),
        own_s,
        total_s: list.estimate_s,
    }
}
