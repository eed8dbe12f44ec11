/* A session of views on two rings, of which none is there yet, and how they come. */
#pragma once

#include "session/session.h"
#include "view_fixture.h"

#define N_RINGS 2
#define N_PHI   4
#define N       (N_RINGS * N_PHI)

/* As view_fixture_material() has its views. */
double capturing_theta_deg(int view);
double capturing_phi_deg(int view);

/* In a folder; g_free() */
char *capturing_session_new(const char *folder);

/* from: of view_fixture_write_btf(GREY, N_RINGS, N_PHI) */
void capturing_move_view(const char *from, const char *session, int view);
