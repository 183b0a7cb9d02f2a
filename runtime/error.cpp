#include "runtime/error.h"

#include <cerrno>

namespace slide {

int exit_code(ErrorKind kind) noexcept {
  switch (kind) {
    case ErrorKind::kUsage:
      return 2;
    case ErrorKind::kBadInput:
      return 3;
    case ErrorKind::kBadWeights:
      return 4;
    case ErrorKind::kOutOfMemory:
      return 5;
    case ErrorKind::kInternal:
      return 6;
    case ErrorKind::kOutput:
      return 7;
    case ErrorKind::kCancelled:
      return 130;
  }
  return 6;
}

ErrorKind kind_of_failure(int system_error, ErrorKind otherwise) noexcept {
  return system_error == ENOMEM ? ErrorKind::kOutOfMemory : otherwise;
}

Error::Error(ErrorKind kind, const std::string& problem, const std::string& remedy)
    : std::runtime_error(remedy.empty() ? problem : problem + " (" + remedy + ")"), kind_(kind) {}

}  // namespace slide
