//! One test binary, modules by behaviour. What takes minutes, since it measures rates over many seeds, is another:
//! `rates.rs`.

mod by_hand; // tables made by hand
mod house; // a fresh directory and the inkling command
mod recipes; // recordings changed in named ways, and what is shown of results
mod recorded; // bursts, recordings and tables: read, written, changed

mod clocks; // a clock that was wrong changes nothing that is told of faults
mod contracts; // pipeline.toml = defaults, schemas = code, sample_logs regenerate and retrain
mod convert; // each acquisition of a table has the values beside its own rows
mod dialects; // recordings of others: any encoding, tables; paths that lead nowhere; hostile schemas
mod failing_calls; // every call of the system fails in turn: the next run makes what an undisturbed one makes
mod floors; // imports go down only
mod follow; // recordings that are being written: told as they grow, tables as of a replay
mod hidden; // recordings with hidden effects give nothing away
mod kills; // killed, locked, out of room, changed while read: nothing mixed, nothing half, the rest judged
mod live; // the live view of a recording that is followed, over plain HTTP
mod live_limits; // the live view where many are connected, are slow, or send too much
mod measured; // real ring-downs, where they are: shown, named, extended, measured
mod memory; // how much memory is held at most, counted
mod mistakes; // what a user mistypes is answered in a sentence
mod mutations; // ten thousand changed files: a message or a result, no panic, bounded memory
mod numbers; // tables of hostile numbers through the critique: an answer or a refusal, no panic
mod own_classes; // own names for what the physics knows keep sizes
mod print_run; // recall and false alarms on a print run with known truth
mod prometheus; // metrics as Prometheus reads them, and the rules for them
mod promised; // what a design promises is what a replay does
mod readers; // everything that reads what others wrote, for mutations and fuzzing
mod readme; // every command of README and book as printed; their links and paths lead somewhere
mod relations; // dates, numbers, directions, names and other heads change nothing
mod report; // sixty recordings are six lines with their onsets
mod several; // faults at once, and faults that grow
mod stops; // the first request to end ends every verb
mod tables; // tables as others read them: rings in every mode
mod tellers; // page, list, JSON and tables tell one account, which rows stand behind
mod thesis_tables; // the thesis's methods by settings; its chapter 4 on own recordings
mod transcripts; // what commands say and leave, session by session, as text in golden/
mod warm_nights; // ink or its sensor at other temperatures than the design knows
mod wire; // code of messages = schemas
