#include "ops/check_report.h"

#include <algorithm>
#include <cstdio>
#include <new>
#include <nlohmann/json.hpp>

#include "runtime/text_table.h"

namespace slide::ops {
namespace {

using Json = nlohmann::ordered_json;

CheckedFile check_file(const std::string& path, Isa isa) {
  CheckedFile result;
  result.file = path;
  try {
    result.check = check_case(read_case(path), isa);
  } catch (const Error& e) {
    result.error = e.what();
    result.error_kind = e.kind();
  } catch (const std::bad_alloc&) {
    result.error = path + ": memory ran out";
    result.error_kind = ErrorKind::kOutOfMemory;
  }
  if (!result.error.empty() && result.error.find(path) == std::string::npos)
    result.error = path + ": " + result.error;
  return result;
}

std::string counted(std::size_t count, const std::string& what) {
  return std::to_string(count) + " " + what + (count == 1 ? "" : "s");
}

/// What there is to say of a kernel that passed.
std::string remark(const KernelCheck& k) {
  std::string text;
  if (k.outside != 0)
    text += ", " + counted(static_cast<std::size_t>(k.outside), "element") + " outside its domain";
  if (k.result_lost()) text += ", but terms cancel until nothing of the result is left";
  return text;
}

void add_rows(TextTable& table, const CheckedFile& file) {
  const CaseCheck& c = *file.check;
  table.heading(file.file + ": " + c.op + (c.attributes == "{}" ? "" : " " + c.attributes) + " gives " +
                c.shape.text());
  table.row({"  float64 definition", scientific(c.reference_error), "", fixed(c.of_tolerance), "",
             c.reference_passed() ? "ok" : "FAILED: not the expected output"});
  for (const KernelCheck& k : c.kernels)
    table.row({"  " + k.kernel, scientific(k.error_expected), scientific(k.error_reference),
               fixed(k.of_bound), of_predicted(k), k.passed() ? "ok" + remark(k) : "FAILED: " + k.verdict()});
  if (c.kernels.empty())
    table.row({"  no kernel", "", "", "", "", "FAILED: no kernel of this level can do the call"});
}

std::string summary_of(const std::vector<CheckedFile>& files) {
  std::size_t cases = 0;
  std::size_t kernels = 0;
  std::size_t failed = 0;
  for (const CheckedFile& f : files) {
    if (!f.check) continue;
    ++cases;
    kernels += f.check->kernels.size();
    if (!f.check->passed()) ++failed;
  }
  std::string text;
  if (cases != files.size()) text = counted(files.size() - cases, "file") + " could not be checked\n";
  if (cases == 0) return text;
  text += counted(cases, "case") + ", " + counted(kernels, "kernel run") + ": ";
  return text + (failed == 0 ? "all within their bounds" : counted(failed, "case") + " FAILED") + "\n";
}

Json json_of(const KernelCheck& k) {
  return {{"kernel", k.kernel},
          {"isa", name_of(k.isa)},
          {"error_vs_expected", k.error_expected},
          {"error_vs_float64", k.error_reference},
          {"of_bound", k.of_bound},
          {"factor", k.factor},
          {"rms", k.rms},
          {"expected_rms", k.expected_rms},
          {"outside_domain", k.outside},
          {"passed", k.passed()},
          {"problem", k.verdict()}};
}

Json json_of(const CheckedFile& f) {
  Json entry{{"file", f.file}};
  if (!f.check) {
    entry["error"] = f.error;
    entry["exit_code"] = slide::exit_code(f.error_kind);
    return entry;
  }
  const CaseCheck& c = *f.check;
  const auto extents = c.shape.extents();
  entry["op"] = c.op;
  entry["attributes"] = Json::parse(c.attributes, nullptr, false);
  entry["source"] = c.source;
  entry["shape"] = std::vector<std::int64_t>(extents.begin(), extents.end());
  entry["reference"] = {{"error_vs_expected", c.reference_error},
                        {"of_tolerance", c.of_tolerance},
                        {"passed", c.reference_passed()}};
  entry["kernels"] = Json::array();
  for (const KernelCheck& k : c.kernels) entry["kernels"].push_back(json_of(k));
  entry["passed"] = c.passed();
  return entry;
}

}  // namespace

std::string scientific(double value) {
  if (value == 0) return "0";
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

std::string fixed(double value) {
  if (value == 0) return "0";
  if (!(value >= 0.001 && value < 1000)) return scientific(value);
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", value);
  return text;
}

std::string of_predicted(const KernelCheck& check) {
  return check.expected_rms > 0 ? fixed(check.rms / check.expected_rms) : "-";
}

std::vector<CheckedFile> check_files(const std::vector<std::string>& paths, Isa isa) {
  std::vector<CheckedFile> result;
  for (const std::string& path : paths) {
    try {
      for (const std::string& file : case_files(path)) result.push_back(check_file(file, isa));
    } catch (const Error& e) {
      result.push_back({path, std::nullopt, e.what(), e.kind()});
    }
  }
  return result;
}

int exit_code(const std::vector<CheckedFile>& files) {
  const auto checked = [](const CheckedFile& f) { return f.check.has_value(); };
  if (std::none_of(files.begin(), files.end(), checked))
    return files.empty() ? slide::exit_code(ErrorKind::kUsage) : slide::exit_code(files.front().error_kind);
  const bool passed = std::all_of(files.begin(), files.end(), [](const CheckedFile& f) {
    return f.check.has_value() && f.check->passed();
  });
  return passed ? 0 : 1;
}

std::string table_of(const std::vector<CheckedFile>& files) {
  using enum TextTable::Align;
  TextTable table({"", "vs expected", "vs float64", "of bound", "rms/predicted", ""},
                  {kLeft, kRight, kRight, kRight, kRight, kLeft});
  for (const CheckedFile& f : files)
    if (f.check) add_rows(table, f);
  const bool checked =
      std::any_of(files.begin(), files.end(), [](const CheckedFile& f) { return f.check.has_value(); });
  return (checked ? table.text() : "") + summary_of(files);
}

std::string json_of(const std::vector<CheckedFile>& files) {
  Json report{{"passed", exit_code(files) == 0}, {"cases", Json::array()}};
  for (const CheckedFile& f : files) report["cases"].push_back(json_of(f));
  return report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace slide::ops
