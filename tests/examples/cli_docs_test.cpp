#include "examples/cli_docs.h"

#include <doctest/doctest.h>

#include <fstream>

#include "tests/examples/program.h"

using namespace slide;

namespace {

/// A program with one option of each kind.
struct Program {
  Program() {
    app.description("Cuts bread.");
    app.add_option("loaf", loaves, "Loaves of bread");
    app.add_flag("-q,--quiet", quiet, "No noise")->group("Running");
    app.add_option("--thickness", thickness, "Of a slice, in mm")->group("Cutting")->capture_default_str();
    app.add_option("--parallel", knife, "Knives")->group("Cutting")->check(CLI::IsMember({"one", "two"}));
    app.add_option("--plate", plate, "Where to. 'C:\\x' is none.")->group("Cutting")->type_name("FILE|auto");
    app.add_option("--secret", plate, "Not documented")->group("");
    app.footer("Examples:\n  .cut loaf  --plate ~/x\n  cut 'a b'\n\nExit codes: 0 done,\n1 stale.");
  }
  CLI::App app;
  std::vector<std::string> loaves;
  bool quiet = false;
  int thickness = 7;
  std::string knife, plate;
};

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

void write_text(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

/// Runs a shell command on this machine (no emulator: it is not the program under test). @return its output
std::string shell(const std::string& command) {
  const TemporaryFolder folder;
  const std::string out = folder.file("out");
  if (std::system(("( " + command + " ) >'" + out + "' 2>&1").c_str()) != 0) return "failed: " + command;
  std::ifstream file(out);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// What bash would offer for a command line, whose last word is being typed; one suggestion a line.
std::string completions(const std::string& script, const std::string& words,
                        const std::string& name = "cut") {
  const TemporaryFolder folder;
  write_text(folder.file("script"), script);
  return shell("cd '" + folder.path().string() + "' && bash -c 'source ./script; COMP_WORDS=(" + words +
               "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _" + name +
               "; printf \"%s\\n\" \"${COMPREPLY[@]}\"'");
}

}  // namespace

TEST_CASE("a manual page has the options by group, their defaults, and the footer's sections") {
  const Program program;
  const std::string page = man_page(program.app, "cut", "BREAD 2");
  CHECK(page.starts_with(".TH \"CUT\" 1 \"\" \"BREAD 2\""));
  CHECK(contains(page, ".SH NAME\ncut \\- cuts bread\n"));
  CHECK(contains(
      page, ".SS \"Cutting\"\n.TP\n\\fB\\-\\-thickness\\fR \\fIINT\\fR\nOf a slice, in mm.\nDefault: 7\n"));
  CHECK(contains(page, "\\fB\\-q\\fR, \\fB\\-\\-quiet\\fR\nNo noise\n"));
  CHECK(contains(page, "\\fI{one,two}\\fR"));
  CHECK(contains(page, "\\(aqC:\\ex\\(aq"));
  CHECK(contains(page, ".SH \"EXAMPLES\"\n.nf\n\\&.cut loaf  \\-\\-plate \\(ti/x\ncut \\(aqa b\\(aq\n.fi\n"));
  CHECK(contains(page, ".SH \"EXIT CODES\"\n0 done,\n1 stale.\n"));
  CHECK(!contains(page, "secret"));
}

TEST_CASE("a manual page has the subcommands with what they take, option groups included") {
  CLI::App app("Bakes.");
  bool hot = false;
  std::string loaf, from;
  CLI::App* const bread = app.add_subcommand("bread", "bake bread");
  bread->add_option("LOAF", loaf, "which")->required();
  CLI::Option_group* const flour = bread->add_option_group("flour");
  flour->add_option("--rye", from, "rye from here");
  flour->add_flag("--hot", hot, "while it is hot");
  app.require_subcommand(1);
  const std::string page = man_page(app, "bake", "BREAD 2");
  CHECK(contains(page, "\\fBbake\\fR \\fIcommand\\fR ..."));
  CHECK(contains(
      page,
      ".SH COMMANDS\n.SS \"bread\"\n\\fBbread\\fR \\fILOAF\\fR [\\fIoption\\fR ...]\n.PP\nbake bread\n"));
  CHECK(contains(page, "\\fB\\-\\-rye\\fR"));
  CHECK(contains(page, "while it is hot"));
  CHECK(!contains(page, ".SH ARGUMENTS"));
  const std::string script = bash_completion(app, "bake");
  CHECK(completions(script, "bake b", "bake") == "bread\n");
  CHECK(completions(script, "bake bread --r", "bake") == "--rye\n");
  CHECK(completions(script, "bake cake --r", "bake") == "\n");
}

TEST_CASE("the manual pages of the programs are clean for groff") {
  for (const char* program : {SLIDE_RUN, SLIDE_CHECK, SLIDE_CONVERT}) {
    CAPTURE(std::string(program));
    const slide::test::ProgramResult page = slide::test::run_program(program, {"--man"});
    REQUIRE(page.code == 0);
    CHECK(contains(page.output, program == std::string(SLIDE_RUN) ? "\\-\\-parallax" : "\\-\\-overwrite"));
    if (shell("command -v groff").starts_with("failed")) {
      MESSAGE("no groff: the page was not formatted");
      continue;
    }
    const TemporaryFolder folder;
    write_text(folder.file("page"), page.output);
    CHECK(shell("groff -man -Tascii -wall '" + folder.file("page") + "' 2>&1 >/dev/null").empty());
  }
}

TEST_CASE("bash completes options and their values") {
  const Program program;
  const std::string script = bash_completion(program.app, "cut");
  CHECK(completions(script, "cut --par") == "--parallel\n");
  CHECK(completions(script, "cut loaf --p") == "--parallel\n--plate\n");
  CHECK(completions(script, "cut --parallel t") == "two\n");
  CHECK(completions(script, "cut --parallel = o") == "one\n");
  CHECK(completions(script, "cut --parallel =") == "one\ntwo\n");
  CHECK(completions(script, "cut --plate s") == "script\n");
  CHECK(completions(script, "cut --plate a") == "auto\n");
  CHECK(completions(script, "cut scr") == "script\n");
  CHECK(completions(script, "cut --sec") == "\n");
  CHECK(completions(script, "cut --thickness s") == "\n");
}

TEST_CASE("the completion of slide_run is a bash script that completes its options") {
  const slide::test::ProgramResult script = slide::test::run_program(SLIDE_RUN, {"--completion"});
  REQUIRE(script.code == 0);
  CHECK(completions(script.output, "slide_run --para", "slide_run") == "--parallax\n");
  CHECK(completions(script.output, "slide_run x.jpg --stereo a", "slide_run") == "anaglyph\n");
}

TEST_CASE("the completion of slide_check completes its commands and their options") {
  const slide::test::ProgramResult script = slide::test::run_program(SLIDE_CHECK, {"--completion"});
  REQUIRE(script.code == 0);
  CHECK(completions(script.output, "slide_check ju", "slide_check") == "judge\n");
  CHECK(completions(script.output, "slide_check judge x.safetensors --unit b", "slide_check") == "bf16\n");
  CHECK(completions(script.output, "slide_check net --form", "slide_check") == "--formula-weights\n");
}

TEST_CASE("every program tells its version, whatever else it needs") {
  for (const char* program : {SLIDE_RUN, SLIDE_CHECK, SLIDE_CONVERT}) {
    const slide::test::ProgramResult result = slide::test::run_program(program, {"--version"});
    CHECK(result.code == 0);
    CHECK(contains(result.output, "\ninstruction set: "));
  }
}
