#include "runtime/text_table.h"

#include <algorithm>

#include "runtime/error.h"

namespace slide {
namespace {

/// Code points of UTF-8 text: all bytes but continuation bytes.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(std::count_if(
      text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

}  // namespace

TextTable::TextTable(std::vector<std::string> titles, std::vector<Align> align)
    : rows_{{std::move(titles), false}}, align_(std::move(align)) {
  if (rows_[0].cells.size() != align_.size())
    throw Error(ErrorKind::kInternal, "a table's titles and alignments differ");
}

void TextTable::row(std::vector<std::string> cells) {
  if (cells.size() > align_.size()) throw Error(ErrorKind::kInternal, "a table's row has too many cells");
  cells.resize(align_.size());
  rows_.push_back({std::move(cells), false});
}

void TextTable::heading(std::string text) { rows_.push_back({{std::move(text)}, true}); }

std::string TextTable::text() const {
  std::vector<std::size_t> widths(align_.size());
  for (const Row& row : rows_)
    for (std::size_t c = 0; c < row.cells.size() && !row.is_heading; ++c)
      widths[c] = std::max(widths[c], width(row.cells[c]));
  std::string result;
  for (const Row& row : rows_) {
    std::string line = row.is_heading ? row.cells[0] : "";
    for (std::size_t c = 0; c < row.cells.size() && !row.is_heading; ++c) {
      if (c != 0) line += "  ";
      const std::string space(widths[c] - width(row.cells[c]), ' ');
      line += align_[c] == Align::kLeft ? row.cells[c] + space : space + row.cells[c];
    }
    line.erase(line.find_last_not_of(' ') + 1);
    result += line + "\n";
  }
  return result;
}

}  // namespace slide
