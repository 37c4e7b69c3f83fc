//! The program's entry: hands the arguments to [`inkling::cli`], and ends with the exit status that
//! it returns.

fn main() -> std::process::ExitCode {
    inkling::cli::run(std::env::args_os()).into()
}
