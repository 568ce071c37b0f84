"""Pictures: the lines, faces and labels on their axes."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from test_export import read_xdmf

import pmalpha as pm
from pmalpha import export, models, structures

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from matplotlib.animation import AbstractMovieWriter  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.collections import LineCollection, PolyCollection, TriMesh  # noqa: E402
from matplotlib.colors import to_rgba  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # noqa: E402
from mpl_toolkits.mplot3d.proj3d import proj_transform  # noqa: E402

from pmalpha import plot  # noqa: E402

# ---- History.plot ---------------------------------------------------------------------------


def four_dof(steps=60, **record):
    chain = models.four_dof()
    return chain.coupler(chain.macro_step, coupling="pm").run(steps=steps, record=record or None)


def made_up(u, multipliers=None, name="a", t=None):
    """A history of one subdomain with these displacements (k, n)."""
    u = np.asarray(u, dtype=float)
    t = np.linspace(0.0, 1.0, len(u)) if t is None else t
    subdomain = pm.SubdomainHistory(name, t, u, 2.0 * u, 3.0 * u, np.arange(u.shape[1]))
    lam = np.zeros((len(u), 0)) if multipliers is None else np.asarray(multipliers, dtype=float)
    return pm.History((subdomain,), lam, t, 1e-3 * lam, 10.0 * lam, t, ((name, None),))


def lines(ax):
    """Data by label."""
    return {line.get_label(): line.get_xydata() for line in ax.lines}


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_energies_that_were_recorded_have_a_panel_and_a_figure_of_their_own():
    coupler = models.four_dof().coupler(0.05, coupling="pm")
    history = coupler.run(steps=20, energy=True)
    panel = history.plot().figure.axes[-1]
    assert panel.get_ylabel() == "energy" and panel.get_xlabel() == "time $t$"
    kinetic = history.energy.kinetic.sum(axis=1)
    assert np.array_equal(lines(panel)["kinetic"], np.column_stack([history.energy.t, kinetic]))
    # no damping, loads or contacts: their works are zero and have no curve
    expected = ["kinetic", "strain", "work of constraints", "added by the steps"]
    assert list(lines(panel)) == expected
    _, ax = pyplot.subplots()
    assert history.plot_energy(ax=ax) is ax and list(lines(ax)) == expected


def test_energies_that_were_not_recorded_are_not_drawn():
    history = four_dof()
    assert "energy" not in [ax.get_ylabel() for ax in history.plot().figure.axes]
    with pytest.raises(ValueError, match="no energies to draw: .*energy=True.* records them"):
        history.plot_energy()


def test_chosen_dofs_jumps_and_multipliers_are_drawn_over_time():
    history = four_dof()
    figure = history.plot({"A": [2, 0], "B": 1}).figure
    dofs, displacement, multiplier = figure.axes
    a, b = history["A"], history["B"]
    expected = {
        "dof 2 of A": (a.t, a.u[:, 2]),
        "dof 0 of A": (a.t, a.u[:, 0]),
        "dof 1 of B": (b.t, b.u[:, 1]),
    }
    assert list(lines(dofs)) == legend(dofs) == list(expected)
    for label, data in expected.items():
        np.testing.assert_array_equal(lines(dofs)[label].T, data)
    for ax, t, x in (
        (displacement, history.macro_times, history.displacement_jump),
        (multiplier, history.multiplier_times, history.multipliers),
    ):
        np.testing.assert_array_equal(lines(ax)["constraint 0"].T, [t, x[:, 0]])
    assert displacement.get_legend() is None  # one constraint needs none


def test_panels_share_one_axis_of_time_and_have_labels():
    history = four_dof()
    axes = history.plot(title="free vibration").figure.axes
    assert all(ax.get_shared_x_axes().joined(axes[0], ax) for ax in axes)
    assert axes[0].get_xlim() == (0.0, history.macro_times[-1])
    names = [ax.get_ylabel().split(" ($")[0] for ax in axes]
    assert names == ["displacement", "displacement\njump", "multiplier"]
    assert axes[-1].get_xlabel() == "time $t$"
    title, note = axes[0].figure.texts
    assert title.get_text() == "free vibration"
    assert note.get_text().startswith("Velocity jump: rounding errors")


def with_jumps(velocity, displacement):
    """A history with jumps of this size, velocities up to 8 and displacements up to 4."""
    u = np.linspace(-4.0, 3.0, 9)[:, None]
    history = made_up(u, np.zeros((9, 1)))
    history.velocity_jump[4], history.displacement_jump[2] = velocity, displacement
    return history


PANELS = ["displacement", "velocity\njump", "displacement\njump", "multiplier"]


@pytest.mark.gate
@pytest.mark.parametrize(
    "velocity, displacement, without, words",
    [
        (-8.1e-12, 4.1e-12, [], ""),
        (
            -2.4e-14,
            1.0,
            [1],
            r"Velocity jump: rounding errors, at most $3 \times 10^{-15}$ of the largest velocity.",
        ),
        (0.0, 1.0, [1], "Velocity jump: zero."),
        (
            7.9e-15,  # 9.9e-16 of the largest velocity
            -4.0e-13,
            [1, 2],
            r"Velocity jump: rounding errors, at most $1 \times 10^{-15}$ of the largest velocity."
            "\nDisplacement jump: rounding errors, at most "
            r"$1 \times 10^{-13}$ of the largest displacement.",
        ),
    ],
)
def test_a_jump_of_rounding_errors_is_a_sentence_and_not_a_panel(
    velocity, displacement, without, words
):
    figure = with_jumps(velocity, displacement).plot().figure
    names = [ax.get_ylabel().split(" ($")[0] for ax in figure.axes]
    assert names == [name for i, name in enumerate(PANELS) if i not in without]
    assert "\n".join(text.get_text() for text in figure.texts) == words
    figure.draw_without_rendering()


def test_jumps_are_drawn_where_no_motion_is_recorded_to_compare_them_with():
    model = models.split_oscillator(10.0)
    history = model.coupler(0.05, coupling="pm").run(steps=5, record={})
    assert 0.0 < np.abs(history.velocity_jump).max() < 1e-12
    assert [ax.get_ylabel().split(" ($")[0] for ax in history.plot().figure.axes] == PANELS[1:]


@pytest.mark.parametrize("quantity, name", [("v", "velocity"), ("a", "acceleration")])
def test_velocities_and_accelerations_can_be_drawn(quantity, name):
    history = four_dof()
    ax = history.plot({"B": [0]}, quantity=quantity).figure.axes[0]
    assert ax.get_ylabel().startswith(name)
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), getattr(history["B"], quantity)[:, 0])


def test_a_power_of_ten_is_in_the_label_and_not_above_the_axis():
    figure = made_up(3e-7 * np.sin(np.linspace(0.0, 9.0, 50))[:, None]).plot().figure
    (ax,) = figure.axes
    figure.draw_without_rendering()
    assert ax.get_ylabel() == "displacement ($10^{-7}$)"
    assert not ax.yaxis.get_offset_text().get_visible()
    assert ax.yaxis.get_major_formatter()(2e-7) == "2"


def test_one_subdomain_without_constraints_has_one_panel():
    subdomain = pm.Subdomain([1.0, 1.0], [4.0, 9.0], scheme=pm.Newmark(), u0=[1.0, 0.5])
    history = pm.Coupler([subdomain], dt=0.1).run(3.0)
    (ax,) = history.plot().figure.axes
    assert list(lines(ax)) == ["dof 0 of subdomain 0", "dof 1 of subdomain 0"]
    (ax,) = history.plot(1).figure.axes
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), history[0].u[:, 1])


def test_by_default_each_subdomain_has_its_share_of_four_curves():
    history = four_dof()
    ranges = np.ptp(history["A"].u, axis=0)
    assert ranges[0] < 0.2 * ranges[1:].min()  # so dof 0 is the one to leave out
    labels = ["dof 1 of A", "dof 2 of A", "dof 0 of B", "dof 1 of B"]
    assert list(lines(history.plot().figure.axes[0])) == labels


def test_of_thousands_of_dofs_a_few_that_move_differently_are_drawn():
    t = np.linspace(0.0, 1.0, 300)[:, None]
    place = np.linspace(0.0, 1.0, 3000)
    u = np.sin(3.0 * t) * place + 0.3 * np.sin(40.0 * t) * np.sin(np.pi * place)
    (ax,) = made_up(u).plot().figure.axes
    drawn = [line.get_ydata() for line in ax.lines]
    assert 2 <= len(drawn) <= 4
    assert max(np.ptp(x) for x in drawn) == np.ptp(u, axis=0).max()
    # curves must not coincide: 2 % of the largest range apart at some time level
    apart = [np.ptp(x - y) for i, x in enumerate(drawn) for y in drawn[:i]]
    assert min(apart) > 0.02 * np.ptp(u, axis=0).max()


def test_dofs_that_move_alike_are_drawn_once():
    t = np.linspace(0.0, 1.0, 300)[:, None]
    (ax,) = made_up(np.sin(9.0 * t) * np.ones(50)).plot().figure.axes
    assert len(ax.lines) == 1


def test_many_constraints_are_a_few_curves_and_the_band_of_all():
    t = np.linspace(0.0, 1.0, 200)[:, None]
    lam = np.cos(7.0 * t + np.arange(300)) * np.linspace(1.0, 5.0, 300)
    axes = made_up(t, lam).plot().figure.axes
    for ax, x in zip(axes[1:], (1e-3 * lam, 10.0 * lam, lam), strict=True):
        assert 2 <= len(ax.lines) <= 4
        (band,) = ax.collections
        edge = band.get_paths()[0].vertices
        for end in (x.min(axis=1), x.max(axis=1)):
            assert {tuple(p) for p in np.column_stack([t[:, 0], end])} <= set(map(tuple, edge))
    assert legend(axes[1])[0] == "all 300 constraints"
    assert legend(axes[1])[1:] == list(lines(axes[1]))


def test_constraints_can_be_chosen():
    lam = np.random.default_rng(0).normal(size=(50, 9))
    axes = made_up(lam, lam).plot(constraints=[7, 2]).figure.axes
    assert list(lines(axes[-1])) == ["constraint 7", "constraint 2"]
    np.testing.assert_array_equal(axes[-1].lines[0].get_ydata(), lam[:, 7])


def test_a_long_history_is_drawn_by_its_extremes():
    rng = np.random.default_rng(1)
    k = 100_003
    x = np.sin(np.linspace(0.0, 3000.0, k)) + 0.1 * rng.normal(size=k)
    history = made_up(x[:, None])
    (ax,) = history.plot().figure.axes
    t, drawn = ax.lines[0].get_data()
    assert len(t) < 5000
    assert np.all(np.diff(t) > 0.0)
    assert (t[0], t[-1]) == (0.0, 1.0)
    assert np.isin(drawn, x).all()
    # a thousandth of the picture has the same highest and lowest point
    for rows in np.array_split(np.arange(k), 1000)[1:-1]:
        begin, end = history[0].t[rows[[0, -1]]]
        near = drawn[(t > begin - 5e-4) & (t < end + 5e-4)]
        assert near.max() >= x[rows].max()
        assert near.min() <= x[rows].min()


def test_curves_differ_without_colour():
    (ax,) = made_up(np.random.default_rng(2).normal(size=(9, 16))).plot({0: None}).figure.axes
    looks = {(str(line._unscaled_dash_pattern), line.get_marker()) for line in ax.lines}
    assert len(looks) == 16


def test_names_are_shown_as_they_are():
    name = "_k_1$^$ " + 60 * "x"
    (ax,) = made_up(np.eye(3), name=name).plot(0).figure.axes
    (label,) = legend(ax)
    assert label.startswith(r"dof 0 of _k_1\$^\$ xxx")
    assert label.endswith("x\N{HORIZONTAL ELLIPSIS}")
    ax.figure.draw_without_rendering()


def test_a_history_of_one_time_level_is_drawn_as_points():
    history = four_dof(steps=0)
    figure = history.plot().figure
    figure.draw_without_rendering()
    assert {line.get_marker() for line in figure.axes[0].lines} == {"o"}


def test_a_history_from_a_file_draws_the_same(tmp_path):
    history = four_dof()
    history.save(tmp_path / "h")
    loaded = pm.History.load(tmp_path / "h")
    for ours, theirs in zip(loaded.plot().figure.axes, history.plot().figure.axes, strict=True):
        assert list(lines(ours)) == list(lines(theirs))
        for label, data in lines(theirs).items():
            np.testing.assert_array_equal(lines(ours)[label], data)


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        ({"dofs": {"A": [1]}}, ValueError, "dofs of 'A' must have been recorded, got 1; .* 0, 2"),
        ({"dofs": {"A": [-4]}}, ValueError, "dofs of 'A' must lie in"),
        ({"dofs": {"A": 0.5}}, TypeError, "dofs of 'A' must be a 1-D array of whole numbers"),
        ({"dofs": {"C": [0]}}, ValueError, "dofs: no subdomain 'C'; there are 'A', 'B'"),
        ({"dofs": {"B": [0]}}, ValueError, "dofs: subdomain 'B' was not recorded"),
        ({"dofs": {7: [0]}}, ValueError, "dofs: there are 2 subdomains, got index 7"),
        ({"dofs": [0]}, TypeError, "dofs must be a dict"),
        ({"dofs": {}}, ValueError, "dofs must name 1 to 16 dofs in all, got 0"),
        ({"constraints": [1]}, ValueError, r"constraints must lie in 0\.\.0, got 1"),
        ({"quantity": "w"}, ValueError, "quantity must be 'u', 'v' or 'a', got 'w'"),
    ],
)
def test_anything_not_recorded_cannot_be_drawn(arguments, error, message):
    history = four_dof(A=[0, 2])
    with pytest.raises(error, match=message):
        history.plot(**arguments)


def test_hundreds_of_curves_are_refused():
    history = made_up(np.zeros((2, 300)), np.zeros((2, 300)))
    with pytest.raises(ValueError, match="dofs must name 1 to 16 dofs in all, got 300"):
        history.plot({0: None})
    with pytest.raises(ValueError, match="constraints must be at most 16 numbers, got 300"):
        history.plot(constraints=np.arange(300))


def test_nothing_recorded_and_no_constraints_is_nothing_to_draw():
    subdomain = pm.Subdomain([1.0], [4.0], scheme=pm.Newmark())
    with pytest.raises(ValueError, match="neither recorded dofs, constraints nor energies"):
        pm.Coupler([subdomain], dt=0.1).run(steps=2, record={}).plot()


def test_without_matplotlib_the_error_names_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    history = made_up(np.eye(2))
    for draw in (
        history.plot,
        lambda: plot.deformed(*SQUARE, np.zeros(8)),
        lambda: plot.animation(made_up(np.zeros((2, 8))), {0: SQUARE}),
    ):
        with pytest.raises(ImportError, match=r"pip install 'pmalpha\[plot\]'"):
            draw()


# ---- deformed meshes ------------------------------------------------------------------------

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), np.array([[0, 1, 2, 3]])


def box(nx, ny, nz):
    """Points and hexahedra of a box of unit cubes, numbered here."""
    points = np.array(
        [(x, y, z) for x in range(nx + 1) for y in range(ny + 1) for z in range(nz + 1)]
    )
    number = {tuple(p): i for i, p in enumerate(points)}
    around = [(0, 0), (1, 0), (1, 1), (0, 1)]
    cells = [
        [number[x + i, y + j, z + k] for k in (0, 1) for i, j in around]
        for x in range(nx)
        for y in range(ny)
        for z in range(nz)
    ]
    return points.astype(float), np.array(cells)


def of(ax, kind):
    return [artist for artist in ax.collections if type(artist) is kind]


def segments(ax):
    """The undeformed mesh: lines drawn as one broken line."""
    drawn = ax.lines[0].get_xydata().reshape(-1, 3, 2)[:, :2]
    return {frozenset(map(tuple, ends)) for ends in drawn.tolist()}


def test_faces_are_drawn_where_they_have_moved_to_over_where_they_were():
    points, elements = SQUARE
    u = np.array([[0.0, 0.0], [0.01, 0.0], [0.03, 0.02], [0.0, 0.01]])
    ax = plot.deformed(points, elements, u, scale=5)
    (faces,) = of(ax, PolyCollection)
    np.testing.assert_array_equal(faces.get_paths()[0].vertices[:4], points + 5.0 * u)
    corners = [tuple(p) for p in points.tolist()]
    around = {frozenset([corners[i], corners[(i + 1) % 4]]) for i in range(4)}
    assert segments(ax) == around
    assert ax.lines[0].get_zorder() < faces.get_zorder()
    assert ax.get_aspect() == 1.0
    low, high = ax.viewLim.get_points()
    assert np.all(low < points.min(axis=0)) and np.all(high > (points + 5.0 * u).max(axis=0))


def test_an_edge_of_two_faces_is_drawn_once():
    points, cells = box(3, 2, 1)
    bottom = points[:, 2] == 0.0
    place = np.cumsum(bottom) - 1
    ax = plot.deformed(points[bottom, :2], place[cells[:, :4]], np.zeros(2 * bottom.sum()))
    # 3 (2 + 1) + 2 (3 + 1)
    assert len(segments(ax)) == len(ax.lines[0].get_xdata()) / 3 == 17
    assert len(of(ax, LineCollection)[0].get_segments()) == 17


def test_displacements_can_be_flat_and_rotations_are_left_out():
    points, elements = SQUARE
    u = np.arange(12.0).reshape(4, 3)
    for given in (u, u.ravel(), u[:, :2], u[:, :2].ravel()):
        ax = plot.deformed(points, elements, given, scale=1)
        drawn = of(ax, PolyCollection)[0].get_paths()[0].vertices[:4]
        np.testing.assert_array_equal(drawn, points + u[:, :2])


@pytest.mark.parametrize("largest", [1e-9, 3e-4, 0.017, 0.9, 4e5])
def test_the_scale_makes_displacements_visible_and_is_written_down(largest):
    points, elements = SQUARE
    ax = plot.deformed(points, elements, [0.0, 0.0, 0.6 * largest, 0.8 * largest] + 4 * [0.0])
    words, scale = ax.get_title(loc="right").split(" × ")
    assert words == "displacements"
    scale = float(scale)
    assert f"{scale:e}"[0] in "125"
    # a tenth of the mesh, which is 2 wide, or the next number below that starts with 1, 2 or 5;
    # or no scale at all where that is a third to three times of it
    assert 0.4 < scale * largest / 0.2 <= 1.0 or (scale == 1.0 and 1 / 3 < largest / 0.2 < 3.0)
    drawn = of(ax, PolyCollection)[0].get_paths()[0].vertices[1]
    np.testing.assert_allclose(drawn - points[1], scale * largest * np.array([0.6, 0.8]), rtol=1e-5)


def test_a_mesh_at_rest_is_drawn_as_it_is():
    ax = plot.deformed(*SQUARE, np.zeros(8))
    assert ax.get_title(loc="right") == "displacements × 1"


def test_several_meshes_have_one_picture_one_scale_and_a_legend():
    points, elements = SQUARE
    ax = plot.deformed(points, elements, np.full(8, 1e-3), label="left")
    scale = float(ax.get_title(loc="right").split(" × ")[1])
    again = plot.deformed(points + [2.0, 0.0], elements, np.full(8, 2e-3), label="right", ax=ax)
    assert again is ax
    first, second = of(ax, PolyCollection)
    moved = points + [2.0, 0.0] + 2e-3 * scale
    np.testing.assert_allclose(second.get_paths()[0].vertices[:4], moved, rtol=1e-15)
    assert legend(ax) == ["left", "right"]
    assert tuple(first.get_facecolor()[0]) != tuple(second.get_facecolor()[0])
    assert ax.viewLim.x1 > 4.0
    with pytest.raises(ValueError, match="scale must be that of the axes, 100, got 7"):
        plot.deformed(points, elements, np.zeros(8), scale=7, ax=ax)


def test_colours_show_values_on_one_bar_for_all_meshes():
    points, elements = SQUARE
    values = np.array([1.0, 2.0, 3.0, 4.0])
    ax = plot.deformed(
        points, elements, np.zeros(8), values=values, value_label="stress", label="a"
    )
    plot.deformed(points + [2.0, 0.0], elements, np.zeros(8), values=5.0 * values, ax=ax)
    first, second = of(ax, TriMesh)
    np.testing.assert_array_equal(first.get_array(), values)
    np.testing.assert_array_equal(second.get_array(), 5.0 * values)
    assert first.norm is second.norm
    assert (first.norm.vmin, first.norm.vmax) == (1.0, 20.0)
    main, bar = ax.figure.axes
    assert main is ax
    assert bar.get_ylabel() == "stress"
    assert bar.get_ylim() == (1.0, 20.0)
    assert [text.get_text() for text in ax.texts] == ["a"]


def test_limits_of_the_colours_can_be_given():
    ax = plot.deformed(*SQUARE, np.zeros(8), values=np.arange(4.0), limits=(-10.0, 10.0))
    assert ax.figure.axes[1].get_ylim() == (-10.0, 10.0)


@pytest.mark.gate
def test_equal_values_have_a_colour_too():
    ax = plot.deformed(*SQUARE, np.zeros(8), values=np.full(4, 2.0))
    ax.figure.draw_without_rendering()


def test_lines_are_drawn_with_colours_along_them():
    points, elements = [[0.0, 0.0], [0.0, 2.0], [3.0, 2.0]], [[0, 1], [1, 2]]
    u = np.array([[0.0, 0.0], [0.4, 0.0], [0.4, 0.0]])
    (beams,) = of(plot.deformed(points, elements, u, scale=1, color="red"), LineCollection)
    np.testing.assert_array_equal(beams.get_segments(), (np.array(points) + u)[elements])
    assert tuple(beams.get_color()[0]) == to_rgba("red")
    (beams,) = of(
        plot.deformed(points, elements, u, scale=1, values=[0.0, 2.0, 6.0]), LineCollection
    )
    middles = np.mean(beams.get_segments(), axis=1)
    # linear along x of the second line: 2 at x = 0.4, 6 at x = 3.4
    second = middles[:, 1] == 2.0
    expected = 2.0 + 4.0 * (middles[second, 0] - 0.4) / 3.0
    np.testing.assert_allclose(beams.get_array()[second], expected, rtol=1e-14)
    assert second.sum() >= 8


def test_points_on_a_line_are_drawn_on_a_line():
    ax = plot.deformed([[0.0], [1.0], [2.0]], [[0, 1], [1, 2]], [0.0, 0.1, 0.4], scale=1)
    (springs,) = of(ax, LineCollection)
    np.testing.assert_allclose(
        springs.get_segments(), [[[0.0, 0.0], [1.1, 0.0]], [[1.1, 0.0], [2.4, 0.0]]], rtol=1e-15
    )
    ax.figure.draw_without_rendering()


@pytest.fixture
def polygons(monkeypatch):
    """The arguments of Poly3DCollection, which does not return them afterwards."""
    handed = []
    set_verts = Poly3DCollection.set_verts

    def remembering(self, verts, closed=True):
        handed.append(np.array(verts))
        set_verts(self, verts, closed)

    monkeypatch.setattr(Poly3DCollection, "set_verts", remembering)
    return handed


def test_of_a_solid_the_outer_faces_are_drawn(polygons):
    points, cells = box(4, 3, 2)
    u = 0.01 * np.random.default_rng(3).normal(size=points.shape)
    ax = plot.deformed(points, cells, u, scale=10)
    (drawn,) = polygons
    assert len(drawn) == 2 * (4 * 3 + 3 * 2 + 2 * 4)
    # each corner is a point that has moved, and each face is in one side of the box
    moved = {tuple(p): q for p, q in zip((points + 10.0 * u).tolist(), points)}
    for face in drawn.tolist():
        corners = np.array([moved[tuple(p)] for p in face])
        assert any(
            np.all(corners[:, i] == side) for i in range(3) for side in (0, points[:, i].max())
        )
    ax.figure.draw_without_rendering()


def test_colours_of_a_solid_are_the_means_of_the_corners():
    points, cells = box(1, 1, 1)
    ax = plot.deformed(points, cells, np.zeros((8, 3)), values=points[:, 0])
    (faces,) = of(ax, Poly3DCollection)
    assert sorted(faces.get_array()) == [0.0, 0.5, 0.5, 0.5, 0.5, 1.0]


def test_a_solid_keeps_its_proportions():
    points, cells = box(6, 2, 1)
    ax = plot.deformed(points, cells, np.zeros((len(points), 3)))
    plot.deformed(points + [6.0, 0.0, 0.0], cells, np.zeros((len(points), 3)), ax=ax)
    assert np.ptp(ax.get_xlim()) > 12.0
    ax.set_proj_type("ortho")
    unit = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    lengths = []
    for elevation, seen in ((90, [0, 1]), (0, [0, 2])):  # from above, from the front
        ax.view_init(elevation, -90)
        x, y, _ = proj_transform(*unit.T, ax.get_proj())
        lengths += list(np.hypot(x[1:] - x[0], y[1:] - y[0])[seen])
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-10)  # rounding of rotations


def test_frames_and_shells_in_space_are_drawn_together():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, -2]], dtype=float)
    elements = {"quad": [[0, 1, 2, 3]], "line": [[0, 4]]}
    ax = plot.deformed(points, elements, np.zeros((5, 6)), values=np.arange(5.0))
    assert len(of(ax, Poly3DCollection)) == len(of(ax, Line3DCollection)) == 1
    ax.figure.draw_without_rendering()


BAD_MESHES = {
    "points must have 1, 2 or 3 columns": {"points": np.zeros((4, 4))},
    "points must be a 2-D array": {"points": np.zeros(4)},
    "points must be finite": {"points": np.full((4, 2), np.nan)},
    "elements must hold node numbers": {"elements": [[0.0, 1.0]]},
    "elements must be a dict by kind .* 2, 3, 4, 8 columns, got 5": {"elements": [[0] * 5]},
    "elements must be 2-D": {"elements": [0, 1]},
    "elements must hold nodes 0..3, got 4": {"elements": [[0, 1, 2, 4]]},
    "elements must hold nodes 0..3, got -1": {"elements": [[0, -1]]},
    "elements must fit the points, got hexahedron with 2": {"elements": [[0] * 8]},
    "elements must be of line, line3, .*, got 'tri3'": {"elements": {"tri3": [[0, 1, 2]]}},
    r"elements\['line'\] must have 2 columns, got 4": {"elements": {"line": [[0, 1, 2, 3]]}},
    "elements must not be empty": {"elements": {}},
    r"u must have shape \(4 d,\) or \(4, d\) with d >= 2 .* got \(7,\)": {"u": np.zeros(7)},
    r"u must have shape .* got \(4, 1\)": {"u": np.zeros((4, 1))},
    r"u must have shape .* got \(3, 2\)": {"u": np.zeros((3, 2))},
    "u must hold real numbers": {"u": [1j] * 8},
    "u must be finite": {"u": [np.inf] * 8},
    r"values must have shape \(4,\), got \(3,\)": {"values": np.zeros(3)},
    "values must be finite": {"values": [0.0, np.nan, 0.0, 0.0]},
    "scale must be positive": {"scale": 0.0},
    "limits must": {"values": np.zeros(4), "limits": (0.0, np.inf)},
}


@pytest.mark.parametrize("message", BAD_MESHES)
def test_meshes_that_do_not_fit_are_refused(message):
    arguments = dict(zip(("points", "elements"), SQUARE), u=np.zeros(8)) | BAD_MESHES[message]
    with pytest.raises((TypeError, ValueError), match=message):
        plot.deformed(**arguments)


def test_a_solid_does_not_go_into_a_plane_picture():
    points, cells = box(1, 1, 1)
    ax = plot.deformed(*SQUARE, np.zeros(8))
    with pytest.raises(ValueError, match="ax must have projection"):
        plot.deformed(points, cells, np.zeros(24), ax=ax)
    solid = plot.deformed(points, cells, np.zeros(24))
    with pytest.raises(ValueError, match="ax must have two dimensions"):
        plot.deformed(*SQUARE, np.zeros(8), ax=solid)


# ---- animation ------------------------------------------------------------------------------


class Spectator(AbstractMovieWriter):
    """A writer that looks at the axes instead of writing."""

    def __init__(self, look):
        super().__init__()
        self.look, self.seen = look, []

    def setup(self, fig, outfile, dpi=None):
        self.fig = fig

    def grab_frame(self, **arguments):
        self.seen.append(self.look(self.fig.axes[0]))

    def finish(self):
        pass


def watched(moving, look):
    spectator = Spectator(look)
    moving.save("nothing is written", writer=spectator)
    return spectator.seen


def corners(ax):
    return [poly.get_paths()[0].vertices[:4].copy() for poly in of(ax, PolyCollection)]


@pytest.mark.gate
def test_an_animation_shows_the_mesh_at_times_equally_far_apart():
    points, elements = SQUARE
    t = np.linspace(0.0, 3.0, 13)
    u = np.outer(t, np.arange(8.0))  # linear in time, so that interpolation is exact
    moving = plot.animation(made_up(u, t=t), {"a": SQUARE}, frames=6, scale=0.5)
    frames = watched(moving, lambda ax: (corners(ax), ax.get_title(loc="left"), ax.get_xlim()))
    assert len(frames) == 6
    for time, (drawn, title, limits) in zip(np.linspace(0.0, 3.0, 6), frames, strict=True):
        (square,) = drawn
        moved = points + 0.5 * time * np.arange(8.0).reshape(4, 2)
        np.testing.assert_allclose(square, moved, rtol=1e-14)
        assert title == f"$t$ = {time:.4g}"
        assert limits == frames[0][2]  # the picture does not move
    # the largest u at a point is 6 times 3, scaled by a half
    assert frames[0][2][1] > 2.0 + 0.5 * 3.0 * 2.0


@pytest.mark.gate
def test_the_film_for_a_notebook_holds_all_frames():
    moving = plot.animation(made_up(np.zeros((3, 8))), {0: SQUARE}, frames=4)
    page = moving.to_jshtml()
    assert page.count("data:image/png;base64") == 4


@pytest.mark.gate
def test_subdomains_with_different_steps_move_together():
    # two squares; the second has a time level in the middle of each step of the first
    t = (np.array([0.0, 2.0]), np.array([0.0, 1.0, 2.0]))
    u = (np.array([[0.0] * 8, [2.0] * 8]), np.array([[0.0] * 8, [5.0] * 8, [0.0] * 8]))
    subdomains = tuple(
        pm.SubdomainHistory(name, t, u, u, u, np.arange(8)) for name, t, u in zip("ab", t, u)
    )
    empty = np.zeros((2, 0))
    keys = (("a", None), ("b", None))
    history = pm.History(subdomains, empty, t[0], empty, empty, t[0], keys)
    mesh = {"a": SQUARE, "b": (SQUARE[0] + [9.0, 0.0], SQUARE[1])}
    moving = plot.animation(history, mesh, frames=5, scale=1)
    frames = watched(moving, corners)
    shifts = [(a[0, 1], b[0, 1]) for a, b in frames]
    np.testing.assert_allclose(shifts, [(0, 0), (0.5, 2.5), (1, 5), (1.5, 2.5), (2, 0)], atol=1e-14)


@pytest.mark.gate
def test_fixed_dofs_are_filled_up():
    points, _ = SQUARE
    free = np.array([2, 3, 4, 5])

    def expand(u):
        whole = np.zeros((len(u), 8))
        whole[:, free] = u
        return whole

    history = made_up(np.array([[0.0] * 4, [0.1, 0.2, 0.3, 0.4]]))
    moving = plot.animation(history, {0: (*SQUARE, expand)}, frames=2, scale=1)
    last = watched(moving, corners)[-1][0]
    np.testing.assert_allclose(last - points, [[0, 0], [0.1, 0.2], [0.3, 0.4], [0, 0]], atol=1e-15)


@pytest.mark.gate
def test_an_object_with_points_and_elements_is_a_mesh():
    mesh = SimpleNamespace(points=SQUARE[0], elements={"quad": SQUARE[1]})
    shift = np.arange(8.0) / 100.0
    history = made_up(np.stack([0.0 * shift, shift]))
    for given in (mesh, (mesh, lambda u: u)):
        moving = plot.animation(history, {0: given}, frames=2, scale=1)
        last = watched(moving, corners)[-1][0]
        np.testing.assert_allclose(last, SQUARE[0] + shift.reshape(4, 2), rtol=1e-14)


@pytest.mark.gate
def test_supports_of_a_structure_are_drawn_and_written_at_rest(tmp_path):
    wall = structures.plate(3, 1, 1.0, E=100.0, nu=0.3, rho=1.0)
    foot, v0 = wall.dofs(wall.nodes_at(x=0.0)), np.zeros(wall.n)
    v0[wall.dofs(wall.nodes_at(x=3.0), "uy")] = 1.0
    held = wall.subdomain(scheme=pm.Newmark(), fixed=foot, v0=v0, name="wall")
    coupler = pm.Coupler([held], dt=0.05)
    history = coupler.run(steps=8)
    whole = np.zeros((9, wall.n))
    whole[:, np.setdiff1d(np.arange(wall.n), foot)] = history["wall"].u
    quads = (wall.points + whole[-1].reshape(-1, 2))[wall.elements["quad"]]

    def drawn(ax):
        return [p.vertices[:4] for p in of(ax, PolyCollection)[0].get_paths()]

    moving = plot.animation(history, {"wall": wall}, frames=3, scale=1)
    np.testing.assert_allclose(watched(moving, drawn)[-1], quads, rtol=0.0, atol=1e-14)
    ax = plot.deformed(wall, history.at(0.4)["wall"], scale=1)
    np.testing.assert_allclose(drawn(ax), quads, rtol=0.0, atol=1e-14)
    export.write_series(tmp_path / "wall.xdmf", wall, history["wall"])
    key = "displacement", "Vector", "Node"
    written = np.array([fields[key] for *_, fields in read_xdmf(tmp_path / "wall.xdmf")])
    np.testing.assert_array_equal(written[..., :2].reshape(9, -1), whole)
    with pytest.raises(TypeError, match="the mesh must come before its motion, got <'wall'"):
        export.write_series(tmp_path / "wrong.xdmf", history["wall"], wall)
    part = coupler.run(steps=8, record={"wall": [0, 1]})
    with pytest.raises(ValueError, match="u of 'wall' for meshes"):  # not the supports alone
        plot.animation(part, {"wall": wall})


def test_several_axes_and_other_things_are_no_ax():
    u, rows = [[0.0, 0.0]] * 4, pyplot.subplots(2)[1]
    history = made_up(np.zeros((2, 8)))
    for call in (
        lambda: history.plot(ax=rows),
        lambda: history[0].plot(ax=rows),
        lambda: plot.deformed(*SQUARE, u, ax=rows),
        lambda: plot.animation(history, {0: SQUARE}, ax=rows),
    ):
        with pytest.raises(TypeError, match="ax must be one Axes of matplotlib, got ndarray"):
            call()
    with pytest.raises(ValueError, match=r"no constraints to draw, got constraints=\[0\]"):
        history.plot(constraints=[0])


@pytest.mark.gate
def test_colours_of_a_film_have_the_limits_of_all_frames():
    u = np.zeros((3, 8))
    u[1, 2], u[2, 2] = -0.3, 0.7
    moving = plot.animation(
        made_up(u), {0: SQUARE}, frames=3, values=lambda u: u[:, 0], value_label="$u_x$"
    )
    frames = watched(
        moving, lambda ax: (of(ax, TriMesh)[0].get_array().copy(), ax.figure.axes[1].get_ylim())
    )
    for expected, (values, limits) in zip(u[:, ::2], frames, strict=True):
        np.testing.assert_allclose(values, expected, atol=1e-16)
        assert limits == (-0.3, 0.7)


def test_a_solid_moves_in_space(polygons):
    points, cells = box(2, 1, 1)
    u = np.stack([np.zeros(points.size), np.tile([0.0, 0.0, 0.5], len(points))])
    moving = plot.animation(made_up(u), {0: (points, cells)}, frames=2, scale=1)
    assert watched(moving, lambda ax: polygons[-1][..., 2].min()) == [0.0, 0.5]


@pytest.mark.parametrize(
    "meshes, options, message",
    [
        ({}, {}, "meshes must be a dict of meshes"),
        ((*SQUARE, lambda u: u, 3), {}, r"meshes must be a Structure or \(points, elements\)"),
        ({0: SQUARE}, {"values": "mises"}, "values must be numbers unless a Structure is drawn"),
        ({0: SQUARE}, {"values": 3.0}, "values must be callable or the name of a stress, got 3.0"),
        ({0: SQUARE}, {"frames": 0}, "frames must be at least 1"),
        ({0: SQUARE}, {"scale": -1.0}, "scale must be positive"),
        (
            {0: (SQUARE[0][:3], [[0, 1]])},
            {},
            r"u of 'a' for meshes\[0\] must have shape \(60, 3 d\)",
        ),
        ({0: SQUARE}, {"values": lambda u: u}, r"the result of values must have shape \(4,\)"),
    ],
)
def test_films_that_do_not_fit_are_refused(meshes, options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        plot.animation(made_up(np.zeros((2, 8))), meshes, **options)


def test_a_film_needs_all_dofs():
    chain = four_dof(A=[0, 2])
    with pytest.raises(ValueError, match="all dofs of 'A' must be recorded, got 0, 2"):
        plot.animation(chain, {"A": ([[0.0], [1.0]], [[0, 1]])})
    with pytest.raises(KeyError, match="'B' was not recorded"):
        plot.animation(chain, {"B": ([[0.0], [1.0]], [[0, 1]])})


# ---- structures, cuts and stresses ----------------------------------------------------------

WALL = structures.plate(4, 2, 0.5, E=10.0, nu=0.3, rho=1.0)
STRETCHED = np.column_stack([0.01 * WALL.points[:, 0] ** 2, 0.0 * WALL.points[:, 0]]).ravel()


def cut_wall():
    """A wall in two subdomains, its history, and the motion of the uncut wall."""
    parts = pm.cut(WALL, parts=2, u0=STRETCHED)
    history = parts.coupler(dt=0.1, coupling="gc").run(steps=3)
    return parts, history, parts.gather(history)


@pytest.mark.gate
def test_all_that_draws_returns_the_axes_it_is_given_and_else_those_of_pyplot():
    parts, history, motion = cut_wall()

    def film(ax):
        (shown,) = watched(plot.animation(motion, WALL, frames=1, ax=ax), lambda ax: ax)
        return shown

    draws = (
        lambda ax: history.plot(ax=ax),
        lambda ax: motion.plot([0, 7], ax=ax),
        lambda ax: plot.deformed(WALL, STRETCHED, ax=ax),
        lambda ax: parts.plot(ax=ax),
        film,
    )
    for draw in draws:
        _, ax = pyplot.subplots()
        assert draw(ax) is ax
        new = draw(None)
        assert isinstance(new, Axes) and pyplot.figure(pyplot.get_fignums()[-1]) is new.figure
        pyplot.close("all")


@pytest.mark.gate
def test_two_histories_in_one_axes_have_different_looks():
    t = np.linspace(0.0, 1.0, 20)
    _, ax = pyplot.subplots()
    for i in range(5):
        made_up(np.sin(t + i)[:, None]).plot(0, ax=ax, title="five", units={"time": "s"})
    looks = {(line.get_color(), line.get_marker()) for line in ax.lines}
    assert len(looks) == len(ax.lines) == len(ax.get_legend().get_texts()) == 5
    assert (ax.get_title(loc="left"), ax.get_xlabel()) == ("five", "time $t$ (s)")
    empty = four_dof(steps=2, A=[])
    with pytest.raises(ValueError, match="the history has no recorded dofs to draw"):
        empty.plot(ax=ax)


def drawn_polygons(ax):
    return np.array([p.vertices[:4] for p in of(ax, PolyCollection)[0].get_paths()])


def test_a_structure_and_a_cut_are_drawn_like_their_mesh():
    parts, _, _ = cut_wall()
    expected = drawn_polygons(plot.deformed(WALL.points, WALL.elements, STRETCHED, scale=2))
    for ax in (plot.deformed(x, STRETCHED, scale=2) for x in (WALL, parts)):
        np.testing.assert_array_equal(drawn_polygons(ax), expected)


@pytest.mark.gate
def test_the_gathered_motion_of_a_cut_moves_like_a_structure():
    parts, history, motion = cut_wall()
    expected = watched(
        plot.animation(motion, (WALL.points, WALL.elements), frames=3), drawn_polygons
    )
    for given in ((motion, WALL), (motion, parts), (history, parts)):
        np.testing.assert_array_equal(
            watched(plot.animation(*given, frames=3), drawn_polygons), expected
        )
    assert np.ptp(expected, axis=0).max() > 0.0
    with pytest.raises(TypeError, match="meshes must be a dict of meshes by subdomain"):
        plot.animation(history, WALL)


@pytest.mark.gate
def test_stresses_of_a_structure_are_colours():
    _, _, motion = cut_wall()
    ax = plot.deformed(WALL, STRETCHED.reshape(-1, 2), values="mises")
    (fill,) = of(ax, TriMesh)
    np.testing.assert_array_equal(fill.get_array(), WALL.stress(STRETCHED))
    assert ax.figure.axes[1].get_ylabel() == "von Mises stress"
    moving = plot.animation(motion, WALL, frames=4, values="xx", value_label="$\\sigma$")
    frames = watched(moving, lambda ax: of(ax, TriMesh)[0].get_array().copy())
    np.testing.assert_allclose(frames, WALL.stress(motion.u, "xx"), rtol=0.0, atol=1e-15)
    with pytest.raises(ValueError, match="what must be 'mises' or 'xx' or 'yy' or 'xy', got 'zz'"):
        plot.deformed(WALL, STRETCHED, values="zz")
    with pytest.raises(TypeError, match="values must be numbers unless a Structure is drawn"):
        plot.deformed(WALL.points, WALL.elements, STRETCHED, values="mises")


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_stresses_of_a_plate_are_those_of_a_solid_between_free_or_fixed_faces(plane):
    """A uniform strain; in plane stress the solid is free to become thinner."""
    flat = structures.plate(2, 2, 1.0, E=10.0, nu=0.3, rho=1.0, plane=plane)
    box = structures.solid(2, 2, 1, 1.0, E=10.0, nu=0.3, rho=1.0)
    H = np.zeros((3, 3))
    H[:2, :2] = [[0.01, 0.002], [0.003, -0.004]]
    H[2, 2] = -0.3 / 0.7 * (H[0, 0] + H[1, 1]) if plane == "stress" else 0.0
    u = (flat.points @ H[:2, :2].T).ravel(), (box.points @ H.T).ravel()
    for what in ("mises", "xx", "yy", "xy"):
        s, S = flat.stress(u[0], what), box.stress(u[1], what)
        np.testing.assert_allclose(s, S[0], rtol=1e-12)  # rounding of sums of a few products
    E, nu = 10.0, 0.3
    sheet = E / (1.0 - nu**2) * (H[0, 0] + nu * H[1, 1])
    if plane == "stress":
        np.testing.assert_allclose(flat.stress(u[0], "xx"), sheet, rtol=1e-12)
    assert flat.stress([u[0], 2.0 * u[0]]).shape == (2, 9)
    with pytest.raises(ValueError, match=r"u must have 18 in the last dimension, got shape \(3,\)"):
        flat.stress(np.zeros(3))


def test_a_mesh_of_any_height_is_drawn_without_warnings():
    points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1e308]]
    ax = pm.plot.deformed(points, [[0, 1, 2, 3]], np.zeros((4, 2)), scale=1.0)
    other = pm.plot.deformed([[0.0, 0.0], [0.0, 1.0]], [[0, 1]], np.zeros((2, 2)), scale=1.0)
    np.testing.assert_array_equal(ax.figure.get_size_inches(), other.figure.get_size_inches())
