//! Question and answer with an instrument, one at a time, whatever its cable.

use super::definition::Definition;
use super::pattern::{Captured, Pattern};
use super::reply::{Complaint, text_of};
use super::way::{Gpib, Raw, Way};
use super::zmtp::Zmq;
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::{Bytes, Transfers};
use crate::twice::{Trouble, twice};
use crate::usbtmc::{Tmc, TmcSettings};
use std::time::Duration;

/// More complaints than the queue of any instrument holds.
const MOST_COMPLAINTS: usize = 64;

/// Whether a cable notices a byte that it alters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cable {
    /// It does (TCP, USB): one answer is enough.
    Checked,
    /// It does not (a serial line): what is read has to be said twice.
    Unchecked,
}

/// A link to an instrument.
///
/// An answer does not say which question it is for, so that a late one could be taken for another's. There is one question at a time, and after everything
/// that went wrong the link is renewed: a TCP connection is closed and opened, buffers of USBTMC and GPIB are cleared; then the instrument is asked who it is, which
/// nothing else asks, and everything before that answer is old. Complaints that wait then are dropped: they are about what went wrong. The question is then asked once more.
pub struct Link {
    way: Box<dyn Way>,
    plan: Plan,
    identity: Option<String>,
    in_step: bool,
}

/// Parts of the device's file that a link needs.
struct Plan {
    device: &'static str,
    cable: Cable,
    reply_within: Duration,
    identify: String,
    pattern: Pattern,
    errors: Option<String>,
}

impl std::fmt::Debug for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Link").field("identity", &self.identity).finish_non_exhaustive()
    }
}

impl Link {
    /// A link over a stream of bytes; nothing is said yet.
    pub fn stream(line: impl Bytes + 'static, cable: Cable, about: &Definition) -> Self {
        Self::new(Box::new(Raw::new(line, about.line_end, about.reply_end)), cable, about)
    }

    /// A link through a Prologix GPIB adapter to the instrument at a GPIB address, 0 to 30; nothing is said yet.
    pub fn gpib(line: impl Bytes + 'static, address: u8, cable: Cable, about: &Definition) -> Self {
        Self::new(Box::new(Gpib::new(about.name, line, address)), cable, about)
    }

    /// A link in requests of ZeroMQ, ZMTP 3.0 without security; nothing is said yet. TCP is under it, which notices what it alters.
    pub fn zeromq(line: impl Bytes + 'static, about: &Definition) -> Self {
        Self::new(Box::new(Zmq::new(about.name, line)), Cable::Checked, about)
    }

    /// A link over USBTMC; nothing is said yet.
    pub fn usbtmc(usb: impl Transfers + 'static, mut tmc: TmcSettings, about: &Definition) -> Self {
        tmc.reply_within = about.timeout;
        Self::new(Box::new(Tmc::new(about.name, usb, tmc)), Cable::Checked, about)
    }

    fn new(way: Box<dyn Way>, cable: Cable, about: &Definition) -> Self {
        let plan = Plan {
            device: about.name,
            cable,
            reply_within: about.timeout,
            identify: about.identify.clone(),
            pattern: about.identity.clone(),
            errors: about.errors.clone(),
        };
        Self { way, plan, identity: None, in_step: false }
    }

    /// Whether the cable notices what it alters.
    pub(super) fn is_checked(&self) -> bool {
        self.plan.cable == Cable::Checked
    }

    /// Brings the link into step and gives who the instrument is.
    ///
    /// # Errors
    /// No answer, or another instrument; see [`DeviceError`].
    pub(super) fn instrument(&mut self, deadline: &Deadline) -> Result<Captured, DeviceError> {
        /// How often an unchecked line may name the instrument until it says the same twice.
        const TRIES: usize = 5;
        let (device, question) = (self.plan.device, self.plan.identify.clone());
        for _ in 0..TRIES {
            self.identity = None;
            let first = twice(device, deadline, || self.synchronise(deadline))?;
            let again = match self.is_checked() {
                true => first.clone(),
                false => match self.ask_as(&question, |answer| Ok(answer.to_owned()), deadline) {
                    Ok(again) => again,
                    // The first name may have been a spoilt one, which nobody says again.
                    Err(DeviceError::Protocol { .. }) => continue,
                    Err(error) => return Err(error),
                },
            };
            if again == first {
                return Ok(self.plan.pattern.of(&first).unwrap_or_default());
            }
        }
        Err(self.protocol(format!("of {TRIES} answers to {question} no two agree: a bad line")))
    }

    /// Asks the instrument again who it is.
    ///
    /// # Errors
    /// The errors of [`ask_surely`](Self::ask_surely).
    pub(super) fn who(&mut self, deadline: &Deadline) -> Result<Captured, DeviceError> {
        let (question, pattern) = (self.plan.identify.clone(), self.plan.pattern.clone());
        let of = |answer: &str| pattern.of(answer).ok_or_else(|| format!("`{}`", pattern.source()));
        let mut who = self.ask_surely(&question, of, deadline)?;
        // A file that insists on a maker has its name as text.
        let maker = pattern.source().split(',').next().filter(|text| !text.contains('{'));
        who.vendor = who.vendor.or(maker.map(|text| text.trim().to_owned()));
        Ok(who)
    }

    /// Asks, and gives what the parser makes of the answer. An answer that it does not understand is asked for once more.
    ///
    /// # Errors
    /// No answer or a spoilt one, twice.
    pub(super) fn ask_as<V>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<V, String>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        twice(self.plan.device, deadline, || {
            let answer = self.once(question, deadline)?;
            parse(&answer).map_err(|expected| {
                self.in_step = false;
                self.spoilt(question, &answer, &expected)
            })
        })
    }

    /// Asks until two answers in a row are the same, where the cable does not notice what it alters: for what does not change by itself.
    ///
    /// # Errors
    /// The errors of [`ask_as`](Self::ask_as); answers that do not agree.
    pub(super) fn ask_surely<V: PartialEq>(
        &mut self,
        question: &str,
        parse: impl Fn(&str) -> Result<V, String>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        /// How often it is asked at most.
        const TRIES: usize = 5;
        let mut last = self.ask_as(question, &parse, deadline)?;
        if self.is_checked() {
            return Ok(last);
        }
        for _ in 1..TRIES {
            let next = self.ask_as(question, &parse, deadline)?;
            if next == last {
                return Ok(next);
            }
            last = next;
        }
        Err(self.protocol(format!("of {TRIES} answers to {question} no two agree: a bad line")))
    }

    /// Sends commands and asks whether the instrument has anything against them. All of that is done once more where something goes wrong on the way: a complaint
    /// that was lost would else be taken for none.
    ///
    /// # Errors
    /// [`DeviceError::Complained`] with the instrument's number and words, or the line's.
    pub(super) fn tell(
        &mut self,
        commands: &[&str],
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        twice(self.plan.device, deadline, || {
            if !self.in_step {
                self.synchronise(deadline)?;
            }
            self.in_step = false;
            for command in commands {
                let step = deadline.at_most(self.plan.reply_within);
                self.way.say(command, &step)?;
            }
            self.in_step = true;
            let Some(first) = self.complaints(deadline)? else { return Ok(()) };
            let (device, request) = (self.plan.device, commands.join("; "));
            let complained =
                DeviceError::Complained { device, request, code: first.code, said: first.text };
            // On a line that alters bytes the command itself may be at fault.
            Err(match self.plan.cable {
                Cable::Checked => Trouble::Final(complained),
                Cable::Unchecked => Trouble::Again(complained),
            })
        })
    }

    /// Fetches all complaints and gives the first.
    fn complaints(&mut self, deadline: &Deadline) -> Result<Option<Complaint>, Trouble> {
        let Some(question) = self.plan.errors.clone() else { return Ok(None) };
        let mut first = None;
        for _ in 0..MOST_COMPLAINTS {
            let answer = self.once(&question, deadline)?;
            let complaint = Complaint::parse(&answer).map_err(|error| {
                self.in_step = false;
                Trouble::Again(self.protocol(format!("the answer to {question}: {error}")))
            })?;
            if complaint.code == 0 {
                return Ok(first);
            }
            first.get_or_insert(complaint);
        }
        let reason = format!("{MOST_COMPLAINTS} complaints and no end: switch it off and on");
        Err(Trouble::Final(self.protocol(reason)))
    }

    fn protocol(&self, reason: String) -> DeviceError {
        DeviceError::Protocol { device: self.plan.device, reason }
    }

    fn spoilt(&self, question: &str, answer: &str, expected: &str) -> Trouble {
        let found = ReplyError::new(answer, "").found;
        let reason = format!("the answer to {question}: found `{found}`, expected {expected}");
        Trouble::Again(self.protocol(reason))
    }

    fn once(&mut self, question: &str, deadline: &Deadline) -> Result<String, Trouble> {
        if !self.in_step {
            self.synchronise(deadline)?;
        }
        // Until the answer is here, whatever interrupts this leaves the link in doubt.
        self.in_step = false;
        let step = deadline.at_most(self.plan.reply_within);
        self.way.say(question, &step)?;
        loop {
            let answer = self.hear(question, &step)?;
            // The second answer to a question that was asked twice while bringing the link into step.
            if self.identity.as_ref() == Some(&answer) && question != self.plan.identify {
                continue;
            }
            self.in_step = true;
            return Ok(answer);
        }
    }

    fn hear(&mut self, question: &str, step: &Deadline) -> Result<String, Trouble> {
        let bytes = self.way.hear(step)?;
        text_of(&bytes).map_err(|error| {
            Trouble::Again(self.protocol(format!("the answer to {question}: {error}")))
        })
    }

    /// Drops what is old: renews the way, asks who the instrument is and reads on until it says so, then drops its complaints.
    fn synchronise(&mut self, deadline: &Deadline) -> Result<String, Trouble> {
        /// So many lines are no leftovers but another device.
        const MOST: usize = 64;
        self.in_step = false;
        let step = deadline.at_most(self.plan.reply_within);
        self.way.renew(&step)?;
        let question = self.plan.identify.clone();
        self.way.say(&question, &step)?;
        let mut last: Option<Trouble> = None;
        for _ in 0..MOST {
            let answer = match self.hear(&question, &step) {
                Ok(answer) => answer,
                // Bytes that are no text, before the name.
                Err(trouble @ Trouble::Again(_)) => {
                    last = Some(trouble);
                    continue;
                }
                // Somebody who speaks, but not so, is not silent.
                Err(Trouble::Transport(error)) if error.is_timeout() => {
                    return Err(last.unwrap_or(Trouble::Transport(error)));
                }
                Err(error) => return Err(error),
            };
            let is_it = match &self.identity {
                // Perhaps behind the first half of a line whose second was lost.
                Some(known) => answer.ends_with(known.as_str()),
                None => self.plan.pattern.of(&answer).is_some(),
            };
            if is_it {
                let known = self.identity.get_or_insert(answer).clone();
                self.in_step = true;
                self.complaints(deadline)?;
                return Ok(known);
            }
            let expected = match &self.identity {
                Some(known) => format!("`{known}`, as before"),
                None => format!("`{}`", self.plan.pattern.source()),
            };
            last = Some(self.spoilt(&question, &answer, &expected));
        }
        let reason = format!("{MOST} lines without an answer to {question}: is it another device?");
        Err(Trouble::Final(self.protocol(reason)))
    }
}
