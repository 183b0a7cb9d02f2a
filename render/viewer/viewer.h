#pragma once

#include <string_view>

namespace slide {

/// The page viewer.html, with {{title}}, {{alt}}, {{still}}, {{label}} and {{scene}} (in this order) to be
/// filled in. Its definition is generated from that file when the project is configured.
extern const std::string_view kViewerPage;

}  // namespace slide
