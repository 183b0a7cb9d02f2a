#include "runtime/text_table.h"

#include <doctest/doctest.h>

#include "runtime/error.h"

using namespace slide;

TEST_CASE("columns are as wide as their widest cell, headings take no part") {
  using enum TextTable::Align;
  TextTable table({"name", "size"}, {kLeft, kRight});
  table.row({"a", "1"});
  table.heading("a heading wider than the table");
  table.row({"U²-Net", "1000000"});
  table.row({"left out"});
  CHECK(table.text() ==
        "name         size\n"
        "a               1\n"
        "a heading wider than the table\n"
        "U²-Net    1000000\n"
        "left out\n");
}

TEST_CASE("a table refuses rows that do not fit") {
  CHECK_THROWS_AS(TextTable({"name"}, {}), Error);
  TextTable table({"name"}, {TextTable::Align::kLeft});
  CHECK_THROWS_AS(table.row({"a", "b"}), Error);
}
