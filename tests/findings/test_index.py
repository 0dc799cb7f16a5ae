"""Which test holds each finding of two trials: with clients of others (C1 to C21), and as a new user (U1 to U24).

A finding without a test has the reason why there is none.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

_TESTS = Path(__file__).parents[1]

#: Finding: what was found, and the tests that fail where it comes back, as `path::test`.
HELD: dict[str, tuple[str, tuple[str, ...]]] = {
    "C1": (
        "a copied environment flies another physics",
        (
            "environments/test_copies.py::test_a_copy_taken_in_mid_episode_continues_as_the_original",
            "environments/test_copies.py::test_supersuit_flies_the_same_environments",
        ),
    ),
    "C2": (
        "a grid search trains the square of its trials",
        ("experiments/test_search.py::test_every_combination_is_trained_once_for_each_sample",),
    ),
    "C3": (
        "curves take the trials of a search for seeds",
        ("figures/test_curves.py::test_the_trials_of_a_search_are_grouped_by_the_values_in_which_they_differ",),
    ),
    "C4": (
        "the contract passes a constraint with a wrong gradient",
        (
            "contract/test_bad_plugins.py::test_the_gradient_of_a_constraint",
            "rta/test_constraint_gradients.py::test_gradients_are_central_differences",
        ),
    ),
    "C5": (
        "a package with a normaliser, or a broken one, stops every command",
        (
            "ground/test_registry.py::test_a_package_may_import_the_bases_of_any_kind",
            "ground/test_registry.py::test_a_package_that_cannot_be_imported_is_named_and_stops_nothing",
        ),
    ),
    "C6": (
        "the usual lines of Stable-Baselines3 fail",
        ("environments/test_rendering.py::test_the_usual_line_of_stable_baselines3",),
    ),
    "C7": (
        "environments without a seed are all alike",
        (
            "environments/test_seeds_and_options.py::test_unseeded_environments_differ_and_name_their_seed",
            "environments/test_stable_baselines3.py::test_plain_factories_start_different_episodes",
        ),
    ),
    "C8": (
        "recurrent policies cannot be flown",
        (
            "experiments/test_recurrent_policy.py::test_the_file_flies_as_the_checkpoint_does",
            "cli/test_commands.py::test_a_policy_that_cannot_be_flown_is_reported_before_the_training",
        ),
    ),
    "C9": (
        "policies of SAC cannot be flown",
        (
            "experiments/test_sac_policy.py::test_its_mean_is_flown",
            "experiments/test_sac_policy.py::test_the_exported_file_gives_its_mean",
        ),
    ),
    "C10": (
        "DQN is accepted and cannot run",
        (
            "experiments/test_dqn_policy.py::test_the_best_combination_is_flown_and_exported",
            "experiments/test_dqn_policy.py::test_the_environments_of_rllib_take_an_index",
            "cli/test_commands.py::test_an_algorithm_that_cannot_learn_the_actions_is_refused",
        ),
    ),
    "C11": (
        "no callbacks, connectors, RLModules, schedulers or loggers from a file",
        (
            "experiments/test_tune_objects.py::test_schedulers_are_built_with_what_stands_within_their_config",
            "experiments/test_tune_objects.py::test_callbacks_are_built",
            "experiments/test_rllib_objects.py::test_connectors_are_built_for_each_pipeline",
            "experiments/test_rllib_objects.py::test_a_module_of_ones_own_gets_its_config",
            "experiments/test_ray_release.py::test_callbacks_are_named_by_their_path",
        ),
    ),
    "C12": (
        "the result of a search cannot be read",
        (
            "experiments/test_search.py::test_the_folder_of_a_search_names_its_trials_and_one_of_them_is_flown",
            "experiments/test_search.py::test_a_trial_of_a_search_is_repeated_alone",
        ),
    ),
    "C13": (
        "the death of a process does not say how to continue",
        (
            "experiments/test_training.py::test_a_runner_that_is_killed_is_one_message_that_says_how_to_continue",
            "experiments/test_resume.py::test_a_killed_training_continues_from_the_newest_good_checkpoint",
        ),
    ),
    "C14": (
        "address=auto may meet another training's private Ray",
        ("experiments/test_cluster.py::test_auto_is_the_cluster_that_was_started_and_no_private_ray",),
    ),
    "C15": (
        "TorchRL's wrappers refuse the environments",
        (
            "integrations/test_torchrl.py::test_the_batch_is_reset_by_mask",
            "integrations/test_torchrl.py::test_a_team_flies_with_numbers_in_its_infos",
        ),
    ),
    "C16": (
        "an override cannot name a key that no file has, nor remove one",
        (
            "config/test_overrides.py::test_a_key_that_no_file_has_is_known_by_its_name",
            "config/test_overrides.py::test_a_place_is_removed",
            "config/test_merge.py::test_a_key_may_be_removed",
        ),
    ),
    "C17": (
        "contracts that authors need are not documented",
        ("examples/test_plugin_package.py::test_the_examples_hold_a_plugin_of_each_kind",),
    ),
    "C18": (
        "platforms are not plugins, and a filter is valid under physics that it does not know",
        (
            "examples/test_plugin_package.py::test_the_formation_flies_with_what_the_package_brings",
            "config/test_guarantees.py::test_what_voids_the_guarantee_is_refused",
        ),
    ),
    "C19": (
        "a reset mask is not checked",
        (
            "environments/test_seeds_and_options.py::test_a_mask_is_one_bool_for_each_environment",
            "environments/test_seeds_and_options.py::test_infos_have_gymnasiums_masks",
        ),
    ),
    "C20": ("nothing is rendered", ("environments/test_rendering.py::test_gymnasium_records_frames",)),
    "C21": (
        "there is no adapter for Stable-Baselines3",
        ("integrations/test_stable_baselines3.py::test_it_flies_what_the_native_batch_flies",),
    ),
    "U1": (
        "a copied environment is wrong",
        ("environments/test_copies.py::test_a_planner_that_copies_at_every_step_changes_nothing",),
    ),
    "U2": (
        "SIGTERM to the process group loses the work",
        ("experiments/test_resume.py::test_a_stopped_training_saves_a_checkpoint_and_leaves_nothing",),
    ),
    "U3": (
        "Ctrl-C in compiled code is a segmentation fault",
        ("cli/test_stopping.py::test_a_search_in_compiled_code_is_stopped_and_leaves_nothing",),
    ),
    "U4": (
        "a film that is stopped hangs, and files are written in place",
        (
            "figures/test_film.py::test_a_film_that_is_stopped_ends_ffmpeg_and_leaves_the_former_one",
            "cli/test_stopping.py::test_a_full_disk_leaves_the_former_file_and_is_one_message",
        ),
    ),
    "U5": (
        "a checkpoint flies in a task with other levels",
        ("evaluation/test_trained_layout.py::test_other_levels_as_a_user_types_them",),
    ),
    "U6": (
        "unseeded resets are alike, options and discrete actions out of range are taken",
        (
            "environments/test_seeds_and_options.py::test_the_environments_of_a_vector_differ",
            "environments/test_seeds_and_options.py::test_unknown_options_are_refused",
            "glues/test_discrete_thrust.py::test_an_action_that_is_no_index_is_refused",
        ),
    ),
    "U7": (
        "a plugin may write into the state",
        ("environments/test_read_only.py::test_a_plugin_that_writes_is_named_and_changes_nothing",),
    ),
    "U8": (
        "the README's command fails without onnxruntime",
        ("integrations/test_load_policy.py::test_a_shipped_policy_flies_without_onnxruntime",),
    ),
    "U9": (
        "an id is not the task of its name",
        ("configs/test_task_ids.py::test_an_id_means_the_task_of_its_name",),
    ),
    "U10": (
        "compiling is silent, and counted in what is left",
        ("cli/test_episode_bar.py::test_compiling_is_not_counted_in_what_is_left",),
    ),
    "U11": (
        "a read-only installation is a traceback",
        ("ground/test_machine_code.py::test_a_kernel_is_compiled_where_no_machine_code_can_be_kept",),
    ),
    "U12": (
        "the message of a short override misleads",
        ("config/test_overrides.py::test_a_key_that_several_places_may_have_and_one_that_is_misspelt",),
    ),
    "U13": (
        "learning_rate is not known",
        ("config/test_overrides.py::test_a_key_that_no_file_has_is_known_by_its_name",),
    ),
    "U14": (
        "commands take an experiment in several forms",
        (
            "cli/test_commands.py::test_an_experiment_is_given_by_its_file_or_by_cfg",
            "cli/test_commands.py::test_what_is_no_command_line_is_refused",
        ),
    ),
    "U15": (
        "curves name recipes by folders",
        ("figures/test_curves.py::test_recipes_are_named_by_the_values_in_which_they_differ",),
    ),
    "U16": (
        "the colours in the key of ten deputies cannot be distinguished",
        ("figures/test_page_in_browser.py::test_the_page_fits_the_screen",),
    ),
    "U17": (
        "the page is no page for a phone",
        (
            "figures/test_page_in_browser.py::test_the_page_fits_the_screen",
            "figures/test_page.py::test_the_page_is_made_for_phones_and_for_both_schemes",
        ),
    ),
    "U18": (
        "the page has no dark scheme, no seed, no task, and marks no speed above the safe one",
        (
            "figures/test_page.py::test_the_page_is_made_for_phones_and_for_both_schemes",
            "figures/test_page.py::test_speed_above_the_safe_one_is_marked",
            "figures/test_figure_commands.py::test_an_episode_is_drawn_filmed_and_viewed",
        ),
    ),
    "U19": (
        "the rows after a resume look like a lost policy",
        ("experiments/test_resume.py::test_a_killed_training_continues_from_the_newest_good_checkpoint",),
    ),
    "U20": (
        "onnxruntime writes into the home folder",
        ("evaluation/test_onnx_policy.py::test_onnxruntime_writes_nothing_into_the_home_folder",),
    ),
    "U21": (
        "a prepared checkpoint runs code",
        ("experiments/test_prepared_checkpoints.py::test_no_command_loads_a_pickle",),
    ),
    "U22": (
        "the bar wraps, log files stay empty, a NaN does not say where it was",
        (
            "cli/test_episode_bar.py::test_the_bar_fits_the_terminal",
            "cli/test_episode_bar.py::test_a_log_file_gets_a_line_every_ten_seconds",
            "environments/test_plugin_values.py::test_a_reward_is_named_and_its_states_are_saved",
        ),
    ),
    "U24": (
        "snippets of the documents show nothing, or need files that nobody has",
        (
            "documentation/test_snippets.py::test_the_python_blocks_of_a_page_run",
            "documentation/test_snippets.py::test_the_commands_of_a_page_parse_and_their_keys_exist",
            "documentation/test_tutorials.py::test_a_tutorial_runs",
        ),
    ),
}

#: Findings that no test holds, and why.
ANSWERED = {"U23": "project_urls need a public address, and the project has none yet; rendering is held by C20"}


def test_every_finding_is_held_or_answered() -> None:
    wanted = {f"C{number}" for number in range(1, 22)} | {f"U{number}" for number in range(1, 25)}
    assert set(HELD) | set(ANSWERED) == wanted
    assert not set(HELD) & set(ANSWERED)


@pytest.mark.parametrize("finding", HELD)
def test_the_tests_of_a_finding_exist(finding: str) -> None:
    _, tests = HELD[finding]
    assert tests
    for test in tests:
        path, _, name = test.partition("::")
        module = ast.parse((_TESTS / path).read_text(encoding="utf-8"))
        defined = {node.name for node in ast.walk(module) if isinstance(node, ast.FunctionDef)}
        assert name in defined, f"{finding}: {path} has no {name}"
