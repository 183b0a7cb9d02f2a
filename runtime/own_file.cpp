#include "runtime/own_file.h"

#include <filesystem>

#include "runtime/error.h"

namespace slide {

void require_own_file(const std::string& path, const std::function<bool(const std::string&)>& is_own) {
  namespace fs = std::filesystem;
  std::error_code code;
  if (!fs::is_regular_file(path, code) || fs::file_size(path, code) == 0 || is_own(path)) return;
  throw Error(ErrorKind::kUsage, path + " exists, and SLIDE has not made it: it would be lost",
              "give the output another name, or add --overwrite");
}

}  // namespace slide
