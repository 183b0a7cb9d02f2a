# Reads the symbols of the objects compiled for one instruction-set level: whatever the linker might merge with another
# object's (weak symbols, nm types V, W, u) must be in that level's namespace. See ops/simd/simd.h.
#   cmake -DNM=nm -DLEVEL=avx512 -DOBJECTS=a.o;b.o -P check_isa_symbols.cmake
execute_process(COMMAND ${NM} -C --defined-only ${OBJECTS} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
string(REPLACE ";" ":" symbols "${symbols}")
string(REGEX MATCHALL "[0-9a-f]+ [VWu] [^\n]+" weak "${symbols}")
string(REGEX MATCHALL "::${LEVEL}::" own "${symbols}")
if(NOT own)
  message(FATAL_ERROR "no symbol of the namespace ${LEVEL} found: wrong objects?")
endif()
set(shared)
foreach(symbol ${weak})
  if(NOT symbol MATCHES "slide::ops::${LEVEL}::" AND NOT symbol MATCHES "DW\\.ref\\.|__clang_call_terminate")
    string(APPEND shared "\n  ${symbol}")
  endif()
endforeach()
if(shared)
  message(FATAL_ERROR "code compiled for ${LEVEL} that other objects might be given:${shared}")
endif()
