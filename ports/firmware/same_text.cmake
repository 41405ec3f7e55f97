# Runs a command; fails unless it ends with 0 and prints what stands in a file.
#   cmake -Dcommand=PROGRAM[;ARGUMENT..] -Dexpected=FILE -P same_text.cmake
execute_process(COMMAND ${command} OUTPUT_VARIABLE text RESULT_VARIABLE status)
file(READ ${expected} right)
message("${text}")
if(NOT status EQUAL 0)
    message(FATAL_ERROR "ended with ${status}, not 0")
endif()
if(NOT text STREQUAL right)
    message(FATAL_ERROR "that is not the text of ${expected}:\n${right}")
endif()
