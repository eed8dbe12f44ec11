/* A session with views on two rings. No view has been processed yet; a test adds them. */
#pragma once

#include "session/session.h"
#include "view_fixture.h"

#define N_RINGS 2
#define N_PHI   4
#define N       (N_RINGS * N_PHI)

/* Directions of a view, which are the same as in view_fixture_material(). */
double capturing_theta_deg(int view);
double capturing_phi_deg(int view);

/* Makes the session in a folder; g_free(). */
char *capturing_session_new(const char *folder);

/* Adds a view. from is a folder that view_fixture_write_btf(GREY, N_RINGS, N_PHI) has made. */
void capturing_move_view(const char *from, const char *session, int view);
