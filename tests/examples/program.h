#pragma once

#include <sys/wait.h>

#include <cstdio>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/temporary_folder.h"

namespace slide::test {

/// What a program did.
struct ProgramResult {
  int code;  ///< exit code; 128 + the signal if one ended it
  std::string output, errors;
};

/// Runs a program of the build (under the emulator, if the build is for another CPU) and waits for its end.
/// @param output  where its standard output goes instead of into the result
inline ProgramResult run_program(const std::string& program, const std::vector<std::string>& arguments,
                                 const std::string& output = "") {
  const auto quoted = [](const std::string& text) {
    std::string result = "'";
    for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return result + "'";
  };
  const auto content = [](const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return std::string{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  };
  const TemporaryFolder folder;
  std::string command = SLIDE_EMULATOR;
  command += " " + quoted(program);
  for (const std::string& argument : arguments) command += " " + quoted(argument);
  command += " >" + quoted(output.empty() ? folder.file("out") : output) + " 2>" + quoted(folder.file("err"));
  const int status = std::system(command.c_str());
  if (status == -1) throw std::runtime_error("cannot run " + command);
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return {code, content(folder.file("out")), content(folder.file("err"))};
}

}  // namespace slide::test
