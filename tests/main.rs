//! One test binary, modules by behaviour. What takes minutes, since it measures rates over many seeds, is another:
//! `rates.rs`.

mod house; // a fresh directory and the inkling command
mod recorded; // bursts, recordings and tables: read, written, changed

mod cli; // process boundary: exit codes, hints in messages
mod contracts; // pipeline.toml = defaults, schemas = code, sample_logs regenerate and retrain
mod convert; // tables become recordings
mod dialects; // recordings of others: any encoding, tables; paths that lead nowhere; hostile schemas
mod floors; // imports go down only
mod follow; // recordings that are being written: told as they grow, tables as of a replay
mod hidden; // recordings with hidden effects give nothing away
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
mod outputs; // results overwrite nothing that is another's
mod own_classes; // own names for what the physics knows keep sizes
mod pipeline; // same bytes for any threads, order, chunking; drift; bad windows
mod print_run; // recall and false alarms on a print run with known truth
mod promised; // what a design promises is what a replay does
mod readers; // everything that reads what others wrote, for mutations and fuzzing
mod readme; // every command of README and book as printed; their links and paths lead somewhere
mod report; // the report: stories over recordings, onsets, hostile names, what is missing
mod several; // faults at once, and faults that grow
mod tables; // tables as others read them: whose a row is, rings, reasons, metadata once
mod thesis_tables; // the thesis's methods by settings; its chapter 4 on own recordings
mod wire; // code of messages = schemas
