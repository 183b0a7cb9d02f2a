# What every target of the project has in common: language, warnings, arithmetic, sanitizers.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_C_STANDARD 11)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_FLAGS_RELEASE "-O3 -DNDEBUG")
set(CMAKE_C_FLAGS_RELEASE "-O3 -DNDEBUG")

if(SLIDE_STATIC)
  set(CMAKE_FIND_LIBRARY_SUFFIXES .a)
endif()
if(SLIDE_SHARED)
  if(SLIDE_STATIC)
    message(FATAL_ERROR "SLIDE_SHARED and SLIDE_STATIC contradict each other")
  endif()
  # Hidden: calls between the project's own functions go straight to them, and the C API is all that a program sees.
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
  set(CMAKE_C_VISIBILITY_PRESET hidden)
  set(CMAKE_CXX_VISIBILITY_PRESET hidden)
  set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
endif()
find_package(OpenMP REQUIRED COMPONENTS CXX)

add_library(slide_flags INTERFACE)
target_include_directories(slide_flags INTERFACE $<BUILD_INTERFACE:${CMAKE_SOURCE_DIR}>)
# No contraction: a*b+c is rounded twice on every CPU unless the code itself asks for a fused operation.
target_compile_options(slide_flags INTERFACE -Wall -Wextra -Wpedantic -Wconversion -ffp-contract=off
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)  # GCC 12 warns falsely on string concatenation (GCC bug 105651)
if(SLIDE_WERROR)
  target_compile_options(slide_flags INTERFACE -Werror)
endif()
if(SLIDE_SANITIZE)
  target_compile_options(slide_flags INTERFACE -fsanitize=${SLIDE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(slide_flags INTERFACE -fsanitize=${SLIDE_SANITIZE})
endif()
if(SLIDE_STATIC)
  target_link_options(slide_flags INTERFACE -static)
endif()

# slide_add_library(NAME sources...): a static library of the project. Users of the installed library get none of the
# flags above.
function(slide_add_library name)
  add_library(${name} STATIC ${ARGN})
  target_link_libraries(${name} PUBLIC $<BUILD_INTERFACE:slide_flags>)
endfunction()

# slide_add_program(NAME sources...): a program, placed in bin/.
function(slide_add_program name)
  add_executable(${name} ${ARGN})
  target_link_libraries(${name} PRIVATE slide_flags)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
endfunction()
