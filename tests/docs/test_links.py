"""The check of links within built pages finds what leads nowhere, and nothing else."""

from docs._generate.links import broken


def test_a_missing_file_and_a_missing_anchor_are_found(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "other.html").write_text('<h1 id="here">Other</h1><a href="../page.html">back</a>')
    (tmp_path / "page.html").write_text(
        '<a href="deep/other.html#here">good</a> <a href="https://example.org/nowhere">outside</a> <a id="top" href="#top">up</a>'
        '<a href="deep/other.html#there">no anchor</a> <img src="missing.png"> <a href="gone.html">no file</a>'
    )
    assert list(broken(tmp_path)) == [
        "page.html links to deep/other.html#there, which has no such anchor",
        "page.html links to gone.html, which is not there",
        "page.html links to missing.png, which is not there",
    ]
