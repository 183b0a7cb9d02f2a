#pragma once

#include <optional>
#include <string>
#include <vector>

#include "ops/check.h"
#include "runtime/error.h"

namespace slide::ops {

/// A case file and what came of it: a check, or an error that kept it from being checked.
struct CheckedFile {
  std::string file;
  std::optional<CaseCheck> check;
  std::string error;                            ///< without a check: the message
  ErrorKind error_kind = ErrorKind::kBadInput;  ///< without a check
};

/// Checks case files and, of folders, all case files in them (see case_files()). A file that cannot be
/// checked does not stop the others.
[[nodiscard]] std::vector<CheckedFile> check_files(const std::vector<std::string>& paths, Isa isa);

/// 0 if every file was checked and is within its bounds; 1 if a check failed, or some files but not all could
/// not be checked; the exit code of the first error if none could.
[[nodiscard]] int exit_code(const std::vector<CheckedFile>& files);

/// One line for each definition and each kernel, and a summary; not the errors of files that could not be
/// checked.
[[nodiscard]] std::string table_of(const std::vector<CheckedFile>& files);
/// The same as a JSON object; numbers that are not finite are null. See docs/slide_check.md.
[[nodiscard]] std::string json_of(const std::vector<CheckedFile>& files);

/// "1.2e-07"; "0" for zero.
[[nodiscard]] std::string scientific(double value);
/// "0.123", or as scientific() below 0.001 and from 1000 on; "0" for zero.
[[nodiscard]] std::string fixed(double value);
/// The RMS error as a multiple of the predicted one, as fixed(); "-" where nothing is predicted.
[[nodiscard]] std::string of_predicted(const KernelCheck& check);

}  // namespace slide::ops
