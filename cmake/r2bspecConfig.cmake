# What `find_package(r2bspec)` gives: ament_add_r2bspec_test().

find_package(ament_cmake_test REQUIRED)

# Of the installation that this file belongs to; else the first in PATH.
find_program(R2BSPEC_EXECUTABLE r2bspec HINTS "${CMAKE_CURRENT_LIST_DIR}/../../../bin" REQUIRED)

# Add a test that runs the benchmark of a spec and passes if its objectives are met.
#
# Its result is ${AMENT_TEST_RESULTS_DIR}/${PROJECT_NAME}/TARGET.xunit.xml, with a case for each
# requirement; the run folder is below ${CMAKE_CURRENT_BINARY_DIR}/r2bspec/runs. ctest runs no other
# test at the same time.
#
# :param spec: a spec or a folder of specs, relative to the current source folder
# :param TARGET: the name of the test, default: that of the file without .r2b.yaml
# :param TIMEOUT: seconds after which ctest ends it, default: 600
# :param INCONCLUSIVE: fail or skip: what it is that objectives are neither met nor missed,
#   default: fail
# :param ARGS: further arguments of `r2bspec run`
# :param SKIP_TEST, RUNNER, ENV, APPEND_ENV, APPEND_LIBRARY_DIRS: those of ament_add_test()
function(ament_add_r2bspec_test spec)
  cmake_parse_arguments(
    PARSE_ARGV 1 ARG "SKIP_TEST" "TARGET;TIMEOUT;INCONCLUSIVE;RUNNER"
    "ARGS;ENV;APPEND_ENV;APPEND_LIBRARY_DIRS")
  if(ARG_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR
      "ament_add_r2bspec_test() called with unused arguments: ${ARG_UNPARSED_ARGUMENTS}")
  endif()
  get_filename_component(path "${spec}" ABSOLUTE BASE_DIR "${CMAKE_CURRENT_SOURCE_DIR}")
  if(NOT EXISTS "${path}")
    message(FATAL_ERROR "ament_add_r2bspec_test() the spec '${path}' does not exist")
  endif()
  if(NOT ARG_TARGET)
    get_filename_component(ARG_TARGET "${path}" NAME)
    string(REGEX REPLACE "\\.r2b\\.yaml$" "" ARG_TARGET "${ARG_TARGET}")
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 600)
  endif()
  set(format junit)
  if(ARG_INCONCLUSIVE STREQUAL "skip")
    set(format junit_lenient)
    # The exit status of an inconclusive run.
    set(options SKIP_RETURN_CODE 3)
  elseif(ARG_INCONCLUSIVE AND NOT ARG_INCONCLUSIVE STREQUAL "fail")
    message(FATAL_ERROR
      "ament_add_r2bspec_test() INCONCLUSIVE is fail or skip, not '${ARG_INCONCLUSIVE}'")
  endif()
  if(ARG_SKIP_TEST)
    list(APPEND options SKIP_TEST)
  endif()
  foreach(name RUNNER ENV APPEND_ENV APPEND_LIBRARY_DIRS)
    if(ARG_${name})
      list(APPEND options ${name} ${ARG_${name}})
    endif()
  endforeach()

  set(folder "${CMAKE_CURRENT_BINARY_DIR}/r2bspec")
  file(MAKE_DIRECTORY "${folder}")
  set(result "${AMENT_TEST_RESULTS_DIR}/${PROJECT_NAME}/${ARG_TARGET}.xunit.xml")
  ament_add_test(
    "${ARG_TARGET}"
    COMMAND "${R2BSPEC_EXECUTABLE}" run "${path}" --quiet "--report=${format}=${result}" ${ARG_ARGS}
    OUTPUT_FILE "${folder}/${ARG_TARGET}.txt"
    RESULT_FILE "${result}"
    TIMEOUT "${ARG_TIMEOUT}"
    WORKING_DIRECTORY "${folder}"
    ${options}
  )
  set_tests_properties("${ARG_TARGET}" PROPERTIES LABELS r2bspec RUN_SERIAL TRUE)
endfunction()
