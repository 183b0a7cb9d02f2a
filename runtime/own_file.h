#pragma once

#include <functional>
#include <string>

namespace slide {

/// Refuses to replace a file that this program has not made. What does not exist, is empty or is no regular
/// file may be written as far as this function is concerned.
/// @param is_own  whether an existing file is this program's, told by its content; asked only where needed
/// @throws Error(kUsage) naming the file that would be lost
void require_own_file(const std::string& path, const std::function<bool(const std::string&)>& is_own);

}  // namespace slide
