"""The server of a scene, which a notebook shows."""

import socket
import urllib.request

import pytest
import smalto


def test_a_server_shows_a_scene_and_its_updates():
    with smalto.serve(smalto.Scene.read("cactus:500"), "--port", "0") as server:
        assert server.is_open and repr(server) == f"Server({server.url})"
        assert f'<iframe src="{server.url}"' in server._repr_html_()
        with urllib.request.urlopen(server.url) as page:
            assert b"<title>smalto</title>" in page.read()
            # A notebook of this machine may show the page.
            assert "frame-ancestors 'self' http://localhost:*" in page.headers["content-security-policy"]
        server.update(smalto.Scene.read("cactus:900"))
    assert not server.is_open and repr(server) == "Server(closed)"
    with pytest.raises(smalto.Error, match="the server is closed"):
        server.update(smalto.Scene.read("cactus:500"))


def test_what_stops_a_server_is_said():
    with pytest.raises(smalto.UnreadableError, match="there is no such file"):
        smalto.serve("missing.ply")
    with pytest.raises(smalto.Error, match="no-such-option"):
        smalto.serve("cactus:100", "--no-such-option")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        with pytest.raises(smalto.Error, match="cannot listen"):
            smalto.serve("cactus:100", "--port", port)


def test_a_proxy_is_the_address_of_the_page():
    proxy = "https://hub.example/user/ann/proxy/7007/"
    with smalto.serve("cactus:100", "--port", "0", "--proxy", proxy) as server:
        assert server.url.startswith(f"{proxy}#token=") and f'src="{server.url}"' in server._repr_html_()


def test_a_server_that_failed_says_why(tmp_path):
    file = tmp_path / "scene.ply"
    file.write_bytes(b"ply\nnonsense")
    # The file is read after the address is known.
    with pytest.raises(smalto.Error, match="scene.ply"):
        smalto.serve(file, "--port", "0").wait()
