#pragma once

/* What is in a session directory, told to people or as JSON; an exit code. */
int info_session(const char *directory);
