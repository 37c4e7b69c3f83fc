//! One test binary, modules by behaviour.

mod house; // a fresh directory and the inkling command

mod cli; // process boundary: exit codes, hints in messages
mod contracts; // pipeline.toml = defaults, schemas = code, sample_logs regenerate and retrain
mod convert; // tables become recordings
mod dialects; // recordings of others: any encoding, arrays and tables; paths that lead nowhere; hostile schemas
mod floors; // imports go down only
mod follow; // recordings that are being written: told as they grow, tables as of a replay
mod foreign; // another generator: healthy families and effects whose constants are not the critique's
mod former; // what former versions wrote: read, judged again, or refused by its version
mod healthy_heads; // healthy heads of other makes, with a slow part, in counts and in volts: nothing is found
mod hidden; // effects hidden in recordings: named, withheld, scored
mod hostile; // absurd recordings, covariates, names, designs, places to write to: rows and words, no panic
mod inspect; // messages of other loggers: fields, layouts by the samples, questions; what is laid out wrongly
mod kills; // killed, locked, out of room, changed while read: nothing mixed, nothing half, the rest judged
mod labels; // states that nobody declared, what is ignored, ranges; what training tells of each class
mod live; // the live view of a recording that is followed, over plain HTTP
mod live_limits; // the live view where many are connected, are slow, or send too much
mod measured; // real ring-downs, where they are: shown, named, extended, measured
mod memory; // how much memory is held at most, counted
mod mistakes; // what a user mistypes is answered in a sentence
mod mutations; // ten thousand changed files: a message or a result, no panic, bounded memory
mod nights; // batches: journal, resume, layouts, baselines in their order; nothing done twice or overwritten
mod not_judged; // a report never calls healthy what nobody judged: that stands first
mod numbers; // tables of hostile numbers through the critique: an answer or a refusal, no panic
mod open_world; // signals of no class, healthy channels of any shape: plants and measurements
mod open_world_goals; // what must hold there: nothing gross is healthy, nothing foreign named
mod outputs; // results overwrite nothing that is another's
mod own_classes; // own names for what the physics knows keep sizes
mod pipeline; // same bytes for any threads, order, chunking; drift; bad windows
mod print_run; // recall and false alarms on a print run with known truth
mod promised; // what a design promises is what a replay does
mod readers; // everything that reads what others wrote, for mutations and fuzzing
mod readme; // every command of README and book as printed; their links and paths lead somewhere
mod report; // the report: stories over recordings, onsets, hostile names, what is missing
mod rotate; // parts of a table whose recording is being written: whole, in order, gone at its end
mod several; // faults at once, and faults that grow
mod tables; // tables as others read them: whose a row is, rings, reasons, metadata once
mod thesis_tables; // thesis chapter 4 on the thesis-form data set
mod unnamed; // oscillators with what the catalogue does not hold: not given the name of its neighbour
mod wire; // code of messages = schemas
