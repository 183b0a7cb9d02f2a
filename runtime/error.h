#pragma once

#include <stdexcept>
#include <string>

namespace slide {

/// What kind of thing went wrong; decides the process exit code and the C API's error code.
enum class ErrorKind {
  kUsage,        ///< a flag or an argument is wrong
  kBadInput,     ///< an image, depth map, matte or camera file is wrong
  kBadWeights,   ///< a weight file or checkpoint is wrong
  kOutOfMemory,  ///< memory ran out, or the plan needs more than was allowed
  kInternal,     ///< a defect of this program
  kOutput,       ///< an output could not be written
  kCancelled,    ///< the caller asked to stop
};

/// The exit code of the command-line programs for an error kind:
/// 2 usage, 3 bad input file, 4 bad weights, 5 out of memory, 6 internal, 7 an output could not be written,
/// 130 cancelled.
[[nodiscard]] int exit_code(ErrorKind kind) noexcept;

/// The kind of a failed system call: kOutOfMemory where that is its reason (ENOMEM), else `otherwise`.
[[nodiscard]] ErrorKind kind_of_failure(int system_error, ErrorKind otherwise) noexcept;

/// The one exception type of the library.
/// `what()` is one sentence that names the file, tensor, offset or flag, followed by the remedy where there
/// is one.
class Error : public std::runtime_error {
 public:
  /// @param kind     category
  /// @param problem  one sentence: what is wrong and where
  /// @param remedy   what to do about it; may be empty
  Error(ErrorKind kind, const std::string& problem, const std::string& remedy = "");

  [[nodiscard]] ErrorKind kind() const noexcept { return kind_; }

 private:
  ErrorKind kind_;
};

}  // namespace slide
