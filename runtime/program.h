#pragma once

#include <functional>
#include <string>

#include "runtime/error.h"

namespace slide {

/// What an exception says, whoever threw it.
struct Failure {
  ErrorKind kind = ErrorKind::kInternal;
  std::string message;
};

/// The exception being handled: an Error as it is; memory or threads that ran out (std::bad_alloc,
/// std::system_error of ENOMEM or EAGAIN) as kOutOfMemory; all else, unknown types included, as kInternal.
/// Only within a catch block.
[[nodiscard]] Failure current_failure();

/// The whole of a command-line program: `run` gives the exit code, unless it throws: then the failure goes to
/// standard error as "NAME: message" and the code is that of its kind. What `run` has printed must reach
/// standard output: where it does not (a full disk, a closed pipe, which raises no signal here), that is a
/// failure of kind kOutput, unless there is one already. Unfinished files are removed on SIGINT, SIGTERM and
/// SIGHUP.
[[nodiscard]] int run_program(const char* name, const std::function<int()>& run) noexcept;

}  // namespace slide
