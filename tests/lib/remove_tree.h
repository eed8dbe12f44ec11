/* Removes what a test or a benchmark has made, with all that is in it; links, not where they lead.
 */
#pragma once

void remove_tree(const char *path);
