#pragma once

#include <string>
#include <vector>

namespace slide {

/// A table of text for people: columns padded to their widest cell, two spaces between. Widths are counted in
/// Unicode code points.
class TextTable {
 public:
  enum class Align { kLeft, kRight };

  /// The column titles and how the cells below them are aligned; as many of both (Error(kInternal)
  /// otherwise).
  TextTable(std::vector<std::string> titles, std::vector<Align> align);
  /// Adds a row; cells left out are empty. Throws Error(kInternal) if there are more cells than columns.
  void row(std::vector<std::string> cells);
  /// Adds a line of its own, which takes no part in the columns.
  void heading(std::string text);
  /// The titles and all rows, a line each, without spaces at the ends of lines.
  [[nodiscard]] std::string text() const;

 private:
  struct Row {
    std::vector<std::string> cells;
    bool is_heading;
  };
  std::vector<Row> rows_;  // the first are the titles
  std::vector<Align> align_;
};

}  // namespace slide
